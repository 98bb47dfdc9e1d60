"""Whether a calibration in force still holds."""
