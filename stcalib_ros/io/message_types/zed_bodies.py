"""``zed_msgs/ObjectsStamped`` of the ZED wrapper: the bodies that a ZED camera tracks.

Keypoints are in the rectified image of the left camera. The 3D joints are metres in the frame of
the left camera (x forward, y left, z up), which the header names; here they are in its optical
frame. Of the 70 slots the first 18, 34 or 38 are filled, as the body format has it. Bodies that are
searched for are predictions of the tracker and left out.
"""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array, IntArray
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

_DEFINITION = "std_msgs/Header header\n{package}/Object[] objects\n"
_FIELDS = {
    "Object": (
        "string label\nint16 label_id\nstring sublabel\nfloat32 confidence\nfloat32[3] position\n"
        "float32[6] position_covariance\nfloat32[3] velocity\nbool tracking_available\n"
        "int8 tracking_state\nint8 action_state\n{package}/BoundingBox2Di bounding_box_2d\n"
        "{package}/BoundingBox3D bounding_box_3d\nfloat32[3] dimensions_3d\n"
        "bool skeleton_available\nint8 body_format\n"
        "{package}/BoundingBox2Df head_bounding_box_2d\n"
        "{package}/BoundingBox3D head_bounding_box_3d\nfloat32[3] head_position\n"
        "{package}/Skeleton2D skeleton_2d\n{package}/Skeleton3D skeleton_3d\n"
    ),
    "BoundingBox2Di": "{package}/Keypoint2Di[4] corners\n",
    "BoundingBox2Df": "{package}/Keypoint2Df[4] corners\n",
    "BoundingBox3D": "{package}/Keypoint3D[8] corners\n",
    "Skeleton2D": "{package}/Keypoint2Df[70] keypoints\n",
    "Skeleton3D": "{package}/Keypoint3D[70] keypoints\n",
    "Keypoint2Di": "uint32[2] kp\n",
    "Keypoint2Df": "float32[2] kp\n",
    "Keypoint3D": "float32[3] kp\n",
}
_SLOTS = 70
"""Keypoints of a skeleton in the message, count, whatever its format. By its definition."""
_LEAST_OBJECT = 1728
"""Bytes that an object takes at least, in float32 alone. By definition of the message."""
_MAX_CONFIDENCE = 99.0
"""Largest confidence of a body; the smallest is 1. By definition of the message."""
_OFF, _OK = 0, 1
"""States of the tracker: the id is not usable; the body was seen. By definition of the message."""

_BODY_34 = (
    "pelvis navel chest neck left_collar left_shoulder left_elbow left_wrist left_hand "
    "left_hand_tip left_thumb right_collar right_shoulder right_elbow right_wrist right_hand "
    "right_hand_tip right_thumb left_hip left_knee left_ankle left_foot right_hip right_knee "
    "right_ankle right_foot head nose left_eye left_ear right_eye right_ear left_heel right_heel"
).split()
_FORMATS = (LAYOUTS["coco_18"].joint_names, tuple(_BODY_34), LAYOUTS["body_38"].joint_names)
"""Joints of BODY_18, BODY_34 and BODY_38, by the number of the format."""

JOINTS = tuple(dict.fromkeys(name for joints in reversed(_FORMATS) for name in joints))
"""Joints of all formats: a message without a body does not say which of them it is of."""

_PLACES = tuple(np.array([JOINTS.index(name) for name in joints]) for joints in _FORMATS)

_R_optical_cam = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])


def _decode(cdr: CdrReader) -> SimpleNamespace:
    header = decode_header(cdr)
    found = [_decode_object(cdr) for _ in range(cdr.count(_LEAST_OBJECT))]
    if header.frame_id and not header.frame_id.endswith("optical"):
        header.frame_id += "_optical"
    return poses(
        header,
        [body for body in found if body is not None],
        layout="zed",
        joint_names=JOINTS,
        rectified=True,
        metric=True,
    )


def _decode_object(cdr: CdrReader) -> SimpleNamespace | None:
    cdr.string()  # label
    label_id = cdr.int16()
    cdr.string()  # sublabel
    confidence = cdr.float32()
    cdr.float32s(12)  # position, its covariance, velocity
    tracked, state = cdr.boolean(), cdr.int8()
    cdr.int8()  # action_state
    cdr.int32s(8)  # bounding_box_2d
    cdr.float32s(27)  # bounding_box_3d, dimensions_3d
    is_body, body_format = cdr.boolean(), cdr.int8()
    cdr.float32s(35)  # boxes and position of the head
    pixels = cdr.float32s(2 * _SLOTS).reshape(_SLOTS, 2)
    points_cam = cdr.float32s(3 * _SLOTS).reshape(_SLOTS, 3)
    if not is_body or (tracked and state not in (_OFF, _OK)):
        return None
    if not 0 <= body_format < len(_FORMATS):
        raise ValueError(
            f"body format {body_format}: known are 0, 1 and 2 (BODY_18, BODY_34, BODY_38)"
        )
    places = _PLACES[body_format]
    pixels[(pixels < 0).any(axis=1)] = np.nan
    points_cam[~points_cam.any(axis=1)] = np.nan
    return person(
        label_id if tracked and state == _OK and label_id >= 0 else NO_TRACK,
        confidence / _MAX_CONFIDENCE,
        keypoints=_at(places, pixels),
        joints=_at(places, points_cam @ _R_optical_cam.T),
    )


def _at(places: IntArray, rows: Float64Array) -> Float64Array:
    """Return the filled slots at their places among all joints, flat; NaN elsewhere."""
    out = np.full((len(JOINTS), rows.shape[1]), np.nan)
    out[places] = rows[: len(places)]
    return out.ravel()


def _of_package(package: str) -> MessageType:
    return MessageType(
        name=f"{package}/msg/ObjectsStamped",
        content=Content.POSES,
        definition=lambda: _DEFINITION.format(package=package),
        dependencies=(
            HEADER,
            TIME,
            *(
                Definition(f"{package}/{name}", partial(fields.format, package=package))
                for name, fields in _FIELDS.items()
            ),
        ),
        decode=_decode,
        topics=("skeletons",),
        only_these=True,
        node=("zed_node", "body_trk"),
        info_topics=(
            *("left/color/rect/camera_info", "rgb/color/rect/camera_info"),
            *("left/color/rect/image/camera_info", "rgb/color/rect/image/camera_info"),
            *("left/camera_info", "rgb/camera_info"),
        ),
        install=f"apt install ros-$ROS_DISTRO-{package.replace('_', '-')}",
    )


ZED_BODIES = _of_package("zed_msgs")
"""As the wrapper has it since 4.1."""

ZED_INTERFACES_BODIES = _of_package("zed_interfaces")
"""The same messages by the name that the package had before."""
