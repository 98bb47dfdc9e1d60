"""Live nodes under load, and the monitoring of a calibration in use."""
