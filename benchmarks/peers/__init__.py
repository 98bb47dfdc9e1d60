"""Other calibration programs on the same scenes, each in an environment of its own."""
