"""A process of its own: publishes one result, latched, and poses until it is killed."""

from __future__ import annotations

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from samples import poses_message, result_message
from stcalib_ros.msg import CalibrationResult, PersonPose3DArray

LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("talker")
    node.create_publisher(CalibrationResult, "result", LATCHED).publish(result_message())
    poses = node.create_publisher(PersonPose3DArray, "cam0/person_poses", qos_profile_sensor_data)
    node.create_timer(0.05, lambda: poses.publish(poses_message()))
    rclpy.spin(node)


if __name__ == "__main__":
    main()
