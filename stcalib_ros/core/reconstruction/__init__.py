"""People from calibrated cameras, and cameras from known people."""
