"""Spatiotemporal bundle adjustment, iterated (STBA, ISTBA)."""
