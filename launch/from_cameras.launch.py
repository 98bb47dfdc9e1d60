"""From cameras to a calibration: `ros2 launch stcalib_ros from_cameras.launch.py`.

Starts the pose estimator and the calibrator.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Two nodes, with the parameter files that are asked for or those that are installed."""
    config = [FindPackageShare("stcalib_ros"), "config"]
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "estimator_file",
                default_value=PathJoinSubstitution([*config, "pose_estimator.yaml"]),
                description="Of the estimator; a copy of config/pose_estimator.yaml with changes.",
            ),
            DeclareLaunchArgument(
                "params_file",
                default_value=PathJoinSubstitution([*config, "calibrator.yaml"]),
                description="Of the calibrator; a copy of config/calibrator.yaml with changes.",
            ),
            DeclareLaunchArgument(
                "namespace",
                default_value="",
                description="Namespace of both nodes, and so of their own topics and services.",
            ),
            _node("pose_estimator", "estimator_file"),
            _node("calibrator", "params_file"),
        ]
    )


def _node(executable: str, argument: str) -> Node:
    return Node(
        package="stcalib_ros",
        executable=executable,
        name=executable,
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration(argument)],
        output="screen",
    )
