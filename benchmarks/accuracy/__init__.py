"""Accuracy on simulated scenes and the demo recording."""
