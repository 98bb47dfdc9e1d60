"""``ros2 run stcalib_ros replay``: ``stcalib calibrate`` with ROS's own deserialiser."""

from __future__ import annotations

import sys

from stcalib_ros.cli import main as stcalib


def main() -> int:
    """Calibrate from the bag that the arguments of the process name.

    The arguments are those of ``stcalib calibrate``; what follows ``--ros-args`` is for ROS.

    Returns
    -------
    int
        Exit status of ``stcalib``; 2 if ROS is not there.
    """
    try:
        from rclpy.utilities import remove_ros_args

        from stcalib_ros.ros.convert import decode
    except ModuleNotFoundError as error:
        print(
            f"replay: no module {error.name!r}: source the workspace's install/setup.bash, "
            "or use `stcalib calibrate`, which needs no ROS",
            file=sys.stderr,
        )
        return 2
    return stcalib(["calibrate", *remove_ros_args(sys.argv)[1:]], decoder=decode)
