"""CPU time and memory of a calibration."""
