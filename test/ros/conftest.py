"""ROS tests stay on this machine and out of each other's way."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

# Before anything imports rclpy; processes started by the tests inherit both.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)


@pytest.fixture(scope="session")
def setup_file() -> Path:
    """To be sourced for packages that have no wheels: tf2_msgs, and those of pose estimators."""
    from underlay import built_underlay

    return built_underlay()
