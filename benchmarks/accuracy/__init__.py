"""Accuracy on simulated scenes and on the demo recording."""
