"""ROS tests stay on this machine and out of each other's way."""

from __future__ import annotations

import os

# Before anything imports rclpy; processes started by the tests inherit both.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
