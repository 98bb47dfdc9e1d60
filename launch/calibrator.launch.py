"""Starts the live calibrator: `ros2 launch stcalib_ros calibrator.launch.py params_file:=FILE`.

With `view:=true` RViz, too, which has to be installed: `sudo apt install ros-$ROS_DISTRO-rviz2`.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """One node, with the parameter file that is asked for or the one that is installed; RViz."""
    share = FindPackageShare("stcalib_ros")
    installed = PathJoinSubstitution([share, "config", "calibrator.yaml"])
    seen = ("markers", "people_markers", "coverage_markers")
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file",
                default_value=installed,
                description="Parameters; a copy of config/calibrator.yaml with what you change.",
            ),
            DeclareLaunchArgument(
                "namespace",
                default_value="",
                description="Namespace of the node, and so of its topics and services.",
            ),
            DeclareLaunchArgument(
                "view",
                default_value="false",
                description="true: start RViz with rviz/calibration.rviz.",
            ),
            Node(
                package="stcalib_ros",
                executable="calibrator",
                name="calibrator",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params_file")],
                output="screen",
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", PathJoinSubstitution([share, "rviz", "calibration.rviz"])],
                remappings=[(f"/calibrator/{t}", _in_namespace(f"calibrator/{t}")) for t in seen],
                condition=IfCondition(LaunchConfiguration("view")),
            ),
        ]
    )


def _in_namespace(topic: str) -> PathJoinSubstitution:
    """Return the full name of a topic of the node, in whatever namespace that is."""
    return PathJoinSubstitution(["/", LaunchConfiguration("namespace"), topic])
