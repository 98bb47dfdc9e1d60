"""What is in a recording, and whether it will calibrate: before anything is solved."""
