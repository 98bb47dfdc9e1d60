"""The calibration itself: no ROS, no files, no plots."""
