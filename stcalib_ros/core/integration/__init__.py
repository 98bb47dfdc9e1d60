"""Multi-view integration: all cameras, and who is who."""
