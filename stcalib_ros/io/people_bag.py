"""People as a bag: ``geometry_msgs/PoseArray``, a topic a person."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stcalib_ros.core.model.arrays import FloatArray
from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory
from stcalib_ros.io.bag_writer import WrittenMessage, write_header, write_messages
from stcalib_ros.io.cdr import CdrWriter
from stcalib_ros.io.files import atomic_path
from stcalib_ros.io.message_types.message_type import (
    HEADER,
    POINT,
    POSE,
    QUATERNION,
    TIME,
    schema_text,
)
from stcalib_ros.io.messages import NS

_POSES, _TEXT = "geometry_msgs/msg/PoseArray", "std_msgs/msg/String"
_DEFINITIONS = {
    _POSES: schema_text(
        "std_msgs/Header header\nPose[] poses\n", (HEADER, TIME, POSE, POINT, QUATERNION)
    ),
    _TEXT: "string data\n",
}
_NAMES = "/people/joint_names"
_UNTURNED = (0.0, 0.0, 0.0, 1.0)


def write_people_bag(
    people: Sequence[PersonTrajectory], epoch_ns: int, frame_id: str, path: Path
) -> None:
    """Write the joints of people in the order of their layout, whose names are a topic, too.

    Parameters
    ----------
    people : sequence of PersonTrajectory
        One or more.
    epoch_ns : int
        Zero of their times, nanoseconds since the Unix epoch.
    frame_id : str
        Frame of the joints.
    path : Path
        A file that is there is replaced.
    """
    topics = {_NAMES: _TEXT} | {_topic(person): _POSES for person in people}
    messages = [
        WrittenMessage(
            stamp_ns := epoch_ns + round(time_s * NS),
            _topic(person),
            _poses_data(joints, stamp_ns, frame_id),
        )
        for person in people
        for time_s, joints in zip(person.times_s.tolist(), person.joints_ref, strict=True)
    ]
    messages.sort(key=lambda message: message.stamp_ns)
    names = CdrWriter()
    names.string(" ".join(people[0].layout.joint_names))
    first = WrittenMessage(messages[0].stamp_ns, _NAMES, names.data())
    with atomic_path(path) as temporary:
        write_messages(topics, _DEFINITIONS, [first, *messages], temporary)


def _topic(person: PersonTrajectory) -> str:
    return f"/people/P{person.person_id}"


def _poses_data(joints: FloatArray, stamp_ns: int, frame_id: str) -> bytes:
    cdr = CdrWriter()
    write_header(cdr, stamp_ns, frame_id)
    cdr.uint32(len(joints))
    turned = np.tile(_UNTURNED, (len(joints), 1))
    cdr.float64s(np.hstack([joints, turned]), fixed=True)
    return cdr.data()
