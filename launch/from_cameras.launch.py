"""From cameras to a calibration: `ros2 launch stcalib_ros from_cameras.launch.py`.

Starts the pose estimator and the calibrator.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

EXECUTABLES = {"pose_estimator": "estimator_file", "calibrator": "params_file"}
"""Each with the argument that names its parameters."""


def generate_launch_description() -> LaunchDescription:
    """Two nodes, with the parameter files that are asked for or those that are installed."""
    config = [FindPackageShare("stcalib_ros"), "config"]
    files = [
        DeclareLaunchArgument(
            argument,
            default_value=PathJoinSubstitution([*config, f"{executable}.yaml"]),
            description=f"Parameters; a copy of config/{executable}.yaml with what you change.",
        )
        for executable, argument in EXECUTABLES.items()
    ]
    namespace = DeclareLaunchArgument(
        "namespace", default_value="", description="Namespace of both nodes."
    )
    nodes = [
        Node(
            package="stcalib_ros",
            executable=executable,
            name=executable,
            namespace=LaunchConfiguration("namespace"),
            parameters=[LaunchConfiguration(argument)],
            output="screen",
        )
        for executable, argument in EXECUTABLES.items()
    ]
    return LaunchDescription([*files, namespace, *nodes])
