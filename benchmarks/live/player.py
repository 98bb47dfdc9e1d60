"""Simulated cameras: a recording played in a loop, in a process of its own."""

from __future__ import annotations

import struct
import time
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from stcalib_ros.io.bag_files import bag_files
from stcalib_ros.io.bag_source import raw_messages
from stcalib_ros.io.messages import NS

_STAMP_AT = 4
"""Byte offset of the header stamp, after the encapsulation header of CDR."""
_LATE_S = 0.1
"""Seconds after its due time from which a message counts as late."""
_FPS = 30.0
"""Frame rate of the recording, Hz: the next loop begins one frame after the last."""
WINDOW_S = 30.0
"""Seconds of data that the node keeps and calibrates."""


@dataclass(frozen=True, slots=True)
class Image:
    """One image of one camera: due time after the start of the loop, and its poses message."""

    due_ns: int
    camera: str
    poses: bytearray


@dataclass(frozen=True, slots=True)
class Sent:
    """Number of messages sent for one camera.

    Attributes
    ----------
    images : int
        Messages of poses.
    in_window : int
        Those of them with a stamp in the last half minute.
    late : int
        Those sent more than a tenth of a second after they were due.
    """

    images: int
    in_window: int
    late: int


def images_of(bag: Path, cameras: Sequence[str]) -> tuple[list[Image], dict[str, bytearray]]:
    """Images of some cameras by time, and the CameraInfo of each.

    All cameras start together and send according to their stamps: all at once, the worst case
    for a subscriber.
    """
    topics = {f"/{name}/person_poses": name for name in cameras}
    infos = {f"/{name}/camera_info": name for name in cameras}
    images: list[Image] = []
    lenses: dict[str, bytearray] = {}
    first = None
    for raw in raw_messages(bag_files(bag), frozenset(topics) | frozenset(infos)):
        first = raw.log_time if first is None else first
        if raw.topic in infos:
            lenses[infos[raw.topic]] = bytearray(raw.data)
        else:
            due_ns = raw.log_time - first
            images.append(Image(due_ns, topics[raw.topic], bytearray(raw.data)))
    return images, lenses


def stamped(data: bytearray, stamp_ns: int) -> bytes:
    """Return the message with another header stamp."""
    struct.pack_into("<iI", data, _STAMP_AT, *divmod(stamp_ns, NS))
    return bytes(data)


def play(bag: Path, cameras: Sequence[str], control: Connection) -> None:
    """Publish poses and CameraInfo of every image of some cameras until asked to stop.

    Parameters
    ----------
    bag : Path
    cameras : sequence of str
    control : Connection
        Sends True once all topics have a subscriber, receives the start time (Unix seconds),
        receives anything as the request to stop, and sends what was `Sent`.
    """
    import rclpy
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import CameraInfo
    from stcalib_ros.msg import PersonPose3DArray

    images, lenses = images_of(bag, cameras)
    rclpy.init()
    node = rclpy.create_node(f"player_{cameras[0]}")
    publishers: dict[str, tuple[Any, Any]] = {
        name: (
            node.create_publisher(
                PersonPose3DArray, f"/{name}/person_poses", qos_profile_sensor_data
            ),
            node.create_publisher(CameraInfo, f"/{name}/camera_info", qos_profile_sensor_data),
        )
        for name in cameras
    }
    while not all(p.get_subscription_count() for pair in publishers.values() for p in pair):
        time.sleep(0.05)
    control.send(True)
    begin_ns = round(control.recv() * NS)
    control.send(_loop(images, lenses, publishers, begin_ns, control))
    node.destroy_node()
    rclpy.shutdown()


def _loop(
    images: Sequence[Image],
    lenses: dict[str, bytearray],
    publishers: dict[str, tuple[Any, Any]],
    begin_ns: int,
    control: Connection,
) -> dict[str, Sent]:
    stamps: dict[str, list[int]] = {name: [] for name in publishers}
    late = dict.fromkeys(publishers, 0)
    length_ns = images[-1].due_ns + round(NS / _FPS)  # the next loop begins one frame later
    while True:
        for image in images:
            rest_s = (begin_ns + image.due_ns - time.time_ns()) / NS
            if control.poll(max(rest_s, 0.0)):
                return {name: _sent(stamps[name], late[name]) for name in publishers}
            late[image.camera] += rest_s < -_LATE_S
            poses, info = publishers[image.camera]
            stamp_ns = begin_ns + image.due_ns
            info.publish(stamped(lenses[image.camera], stamp_ns))
            poses.publish(stamped(image.poses, stamp_ns))
            stamps[image.camera].append(stamp_ns)
        begin_ns += length_ns


def _sent(stamps: Sequence[int], late: int) -> Sent:
    oldest = stamps[-1] - round(WINDOW_S * NS) if stamps else 0
    return Sent(len(stamps), sum(stamp >= oldest for stamp in stamps), late)
