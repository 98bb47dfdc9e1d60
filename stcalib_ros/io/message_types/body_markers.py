"""``visualization_msgs/MarkerArray`` of the drivers of Azure Kinect and Orbbec: tracked bodies.

A sphere is a joint, its id 100 times the body's and the joint's number in the body tracking SDK. It
lies in the optical frame of the depth camera, in metres. There are no keypoints: those of the depth
image are where its lens projects the joints. A message without a body has no header either.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.io.cdr import CdrReader
from stcalib_ros.io.message_types.message_type import (
    HEADER,
    POINT,
    POSE,
    QUATERNION,
    TIME,
    VECTOR3,
    Content,
    Definition,
    MessageType,
    decode_header,
)
from stcalib_ros.io.message_types.pose_content import person, poses

_MARKER = """\
std_msgs/Header header
string ns
int32 id
int32 type
int32 action
geometry_msgs/Pose pose
geometry_msgs/Vector3 scale
std_msgs/ColorRGBA color
builtin_interfaces/Duration lifetime
bool frame_locked
geometry_msgs/Point[] points
std_msgs/ColorRGBA[] colors
string texture_resource
sensor_msgs/CompressedImage texture
UVCoordinate[] uv_coordinates
string text
string mesh_resource
MeshFile mesh_file
bool mesh_use_embedded_materials
"""
_COLOR = "float32 r\nfloat32 g\nfloat32 b\nfloat32 a\n"
_IMAGE = "std_msgs/Header header\nstring format\nuint8[] data\n"

_SPHERE, _ADD = 2, 0
"""Type and action of the marker of a joint. By definition of the message."""
_BODY = 100
"""Ids from one body to the next. By the code of the driver."""
_LEAST_MARKER = 180
"""Bytes that a marker takes at least: 120 of numbers, and its texts and lists. By definition."""

_SIDES = {
    side: (
        [f"{side}_{joint}" for joint in ("collar", "shoulder", "elbow", "wrist", "hand")]
        + [f"{side}_hand_tip", f"{side}_thumb"],
        [f"{side}_{joint}" for joint in ("hip", "knee", "ankle", "foot")],
    )
    for side in ("left", "right")
}
JOINTS = (
    *("pelvis", "navel", "chest", "neck"),
    *(*_SIDES["left"][0], *_SIDES["right"][0], *_SIDES["left"][1], *_SIDES["right"][1]),
    *("head", "nose", "left_eye", "left_ear", "right_eye", "right_ear"),
)
"""Joints in the order of the body tracking SDK (``k4abt_joint_id_t``)."""


def _decode(cdr: CdrReader) -> SimpleNamespace | None:
    markers = [_decode_marker(cdr) for _ in range(cdr.count(_LEAST_MARKER))]
    spheres = [one for one in markers if (one.type, one.action) == (_SPHERE, _ADD)]
    if not spheres:
        return None
    bodies: dict[int, Float64Array] = {}
    for one in spheres:
        body, joint = divmod(one.id, _BODY)
        if body < 0 or joint >= len(JOINTS):
            raise ValueError(f"marker {one.id}: expected 100 * body + joint, joints 0 to 31")
        bodies.setdefault(body, np.full((len(JOINTS), 3), np.nan))[joint] = one.position
    return poses(
        spheres[0].header,
        [person(body, 1.0, joints=joints.ravel()) for body, joints in bodies.items()],
        layout="k4abt_32",
        joint_names=JOINTS,
        metric=True,
        project=True,
    )


def _decode_marker(cdr: CdrReader) -> SimpleNamespace:
    header = decode_header(cdr)
    cdr.string()  # ns
    number, kind, action = cdr.int32(), cdr.int32(), cdr.int32()
    position = cdr.float64s(10)[:3]  # pose and scale
    cdr.float32s(4)  # color
    cdr.int32s(2)  # lifetime
    cdr.boolean()
    cdr.float64s(3 * cdr.count(24))  # points
    cdr.float32s(4 * cdr.count(16))  # colors
    cdr.string()
    decode_header(cdr)  # texture
    cdr.string()
    cdr.skip(cdr.count(1))
    cdr.float32s(2 * cdr.count(8))  # uv_coordinates
    for _ in range(3):  # text, mesh_resource, name of mesh_file
        cdr.string()
    cdr.skip(cdr.count(1))
    cdr.boolean()
    return SimpleNamespace(header=header, id=number, type=kind, action=action, position=position)


BODY_MARKERS = MessageType(
    name="visualization_msgs/msg/MarkerArray",
    content=Content.POSES,
    definition=lambda: "Marker[] markers\n",
    dependencies=(
        *(HEADER, TIME, POSE, POINT, QUATERNION, VECTOR3),
        Definition("visualization_msgs/Marker", lambda: _MARKER),
        Definition("visualization_msgs/UVCoordinate", lambda: "float32 u\nfloat32 v\n"),
        Definition("visualization_msgs/MeshFile", lambda: "string filename\nuint8[] data\n"),
        Definition("std_msgs/ColorRGBA", lambda: _COLOR),
        Definition("sensor_msgs/CompressedImage", lambda: _IMAGE),
        Definition("builtin_interfaces/Duration", lambda: "int32 sec\nuint32 nanosec\n"),
    ),
    decode=_decode,
    topics=("body_tracking_data",),
    only_these=True,
    info_topics=("depth/camera_info",),
    bytes_factor=12,
)
"""As ROS 2 has it since Humble."""
