"""Does a calibration still hold? People who come later tell."""
