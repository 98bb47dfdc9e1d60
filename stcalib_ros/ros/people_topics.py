"""Topics of people, where every one has their own: which there are now."""

from __future__ import annotations

from typing import Any

from stcalib_ros.io.topic_names import camera_name, is_of_people
from stcalib_ros.io.topics import SelectedCamera


def topics_of_people(node: Any, camera: SelectedCamera) -> dict[str, str]:
    """Topics of the people whom a camera sees now, with their types.

    Parameters
    ----------
    node : rclpy.node.Node
    camera : SelectedCamera
        Its `pose_topic` has a ``*`` in place of the id.
    """
    pattern = node.resolve_topic_name(camera.pose_topic.replace("*", "any"))
    wanted, last = camera_name(pattern, camera.pose_type), pattern.rpartition("/")[2]
    return {
        topic: kind
        for topic, kinds in node.get_topic_names_and_types()
        for kind in kinds
        if is_of_people(topic, kind, camera.pose_type)
        and camera_name(topic, kind) == wanted
        and (kind != camera.pose_type or topic.rpartition("/")[2] == last)
        and node.count_publishers(topic) > 0
    }
