"""``hri_msgs/Skeleton2D`` of ROS4HRI: the keypoints of one person, on a topic of that person.

They are fractions of the image. The joints are those of OpenPose's COCO model, but for eyes and
ears, of which the message has the left ones first. ``hri_msgs/IdsList`` lists the persons; where
that is empty, an image has none.
"""

from __future__ import annotations

from types import SimpleNamespace

from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.io.cdr import CdrReader
from stcalib_ros.io.message_types.message_type import (
    HEADER,
    TIME,
    Content,
    Definition,
    MessageType,
    decode_header,
)
from stcalib_ros.io.message_types.pose_content import NO_TRACK, person, poses

_BODY = LAYOUTS["coco_18"].joint_names[:-4]
JOINTS = (*_BODY, "left_eye", "right_eye", "left_ear", "right_ear")
"""Joints in the order of the constants of the message."""

_NODE = ("humans", "bodies")
_INSTALL = "apt install ros-$ROS_DISTRO-hri-msgs"


def _decode(cdr: CdrReader) -> SimpleNamespace:
    header = decode_header(cdr)
    rows = cdr.float32s(3 * len(JOINTS)).reshape(-1, 3)
    scores = rows[:, 2]
    seen = person(
        NO_TRACK, float(scores.mean()), keypoints=rows[:, :2].ravel(), joint_scores=scores
    )
    return _image(header, [seen])


def _decode_ids(cdr: CdrReader) -> SimpleNamespace | None:
    header, ids = decode_header(cdr), cdr.strings()
    is_of_an_image = header.stamp.sec != 0 or header.stamp.nanosec != 0
    return _image(header, []) if is_of_an_image and not ids else None


def _image(header: SimpleNamespace, persons: list[SimpleNamespace]) -> SimpleNamespace:
    return poses(header, persons, layout="hri_18", joint_names=JOINTS, fractions=True)


HRI_SKELETONS = MessageType(
    name="hri_msgs/msg/Skeleton2D",
    content=Content.POSES,
    definition=lambda: "std_msgs/Header header\nNormalizedPointOfInterest2D[18] skeleton\n",
    dependencies=(
        HEADER,
        TIME,
        Definition(
            "hri_msgs/NormalizedPointOfInterest2D", lambda: "float32 x\nfloat32 y\nfloat32 c\n"
        ),
    ),
    decode=_decode,
    topics=("skeleton2d",),
    topic_per_person=True,
    nobody_type="hri_msgs/msg/IdsList",
    node=_NODE,
    info_topics=("color/camera_info", "rgb/camera_info"),
    install=_INSTALL,
)
"""As ROS4HRI has it for ROS 2."""

HRI_IDS = MessageType(
    name=HRI_SKELETONS.nobody_type,
    content=Content.NOBODY,
    definition=lambda: "std_msgs/Header header\nstring[] ids\n",
    dependencies=(HEADER, TIME),
    decode=_decode_ids,
    topics=("tracked",),
    only_these=True,
    node=_NODE,
    install=_INSTALL,
)
"""As ROS4HRI has it for ROS 2."""
