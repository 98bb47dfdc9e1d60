"""A process of its own: prints the first message of /tf_static as JSON."""

from __future__ import annotations

import json

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from tf2_msgs.msg import TFMessage

LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("tf_listener")
    received: list[TFMessage] = []
    node.create_subscription(TFMessage, "/tf_static", received.append, LATCHED)
    while not received:
        rclpy.spin_once(node)
    frames = {}
    for transform in received[0].transforms:
        t = transform.transform.translation
        frames[transform.child_frame_id] = [transform.header.frame_id, t.x, t.y, t.z]
    print(json.dumps(frames), flush=True)


if __name__ == "__main__":
    main()
