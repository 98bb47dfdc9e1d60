"""Decides whether a calibration can be trusted."""
