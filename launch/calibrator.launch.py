"""Starts the live calibrator: `ros2 launch stcalib_ros calibrator.launch.py params_file:=FILE`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """One node, with the parameter file that is asked for or the one that is installed."""
    installed = PathJoinSubstitution([FindPackageShare("stcalib_ros"), "config", "calibrator.yaml"])
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
            Node(
                package="stcalib_ros",
                executable="calibrator",
                name="calibrator",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params_file")],
                output="screen",
            ),
        ]
    )
