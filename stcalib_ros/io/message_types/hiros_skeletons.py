"""``hiros_skeleton_msgs/SkeletonGroup`` of Hi-ROS: what a detector finds in one image.

Markers have names, which the message does not fix: those of our layouts are taken. They are metres
in the optical frame of the camera, or pixels where z is NaN. The time of the image is the source's,
for that of the header is when the message was sent; without a skeleton, nothing says it.
"""

from __future__ import annotations

import re
from functools import lru_cache, partial
from types import SimpleNamespace

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.io.cdr import CdrReader
from stcalib_ros.io.message_types.body_markers import JOINTS as KINECT_JOINTS
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
from stcalib_ros.io.message_types.pose_content import NO_TRACK, person, poses

_PACKAGE = "hiros_skeleton_msgs"
_TWIST = "Vector3 linear\nVector3 angular\n"
_FIELDS = {
    "Skeleton": (
        "int32 id\nbuiltin_interfaces/Time src_time\nstring src_frame\nuint32 max_markers\n"
        "uint32 max_links\nfloat64 confidence\nBox bounding_box\nMarker[] markers\nLink[] links\n"
    ),
    "Box": "KinematicState center\nfloat64 height\nfloat64 length\nfloat64 width\n",
    "KinematicState": (
        "geometry_msgs/Pose pose\ngeometry_msgs/Twist velocity\ngeometry_msgs/Accel acceleration\n"
    ),
    "Marker": "int32 id\nstring name\nfloat64 confidence\nKinematicState center\n",
    "Link": (
        "int32 id\nstring name\nint32 parent_marker\nint32 child_marker\nfloat64 confidence\n"
        "KinematicState center\n"
    ),
}
_STATE = 19
"""Numbers of a kinematic state: pose, velocity, acceleration. By definition of the message."""
_LEAST_SKELETON, _LEAST_MARKER, _LEAST_LINK = 224, 169, 177
"""Bytes that a skeleton, a marker and a link take at least. By definition of the message."""

_BODIES = [names.joint_names for name, names in LAYOUTS.items() if name != "coco_wholebody_133"]
JOINTS = tuple(dict.fromkeys(joint for joints in (*_BODIES, KINECT_JOINTS) for joint in joints))
"""Joints that are taken: those of our layouts, and of the body tracking SDK of Azure Kinect."""

_SAME = {
    "spine_navel": "navel",
    "spine_naval": "navel",
    "spine_chest": "chest",
    "left_clavicle": "left_collar",
    "right_clavicle": "right_collar",
    "left_handtip": "left_hand_tip",
    "right_handtip": "right_hand_tip",
}


def _decode(cdr: CdrReader) -> SimpleNamespace | None:
    header = decode_header(cdr)
    found = [_decode_skeleton(cdr) for _ in range(cdr.count(_LEAST_SKELETON))]
    if not found:
        return None
    if len(sources := {(s.sec, s.nanosec, s.frame) for s in found}) > 1:
        raise ValueError(
            f"skeletons of {len(sources)} images in one message; expected what one detector sends"
        )
    source = found[0]
    if source.sec or source.nanosec:
        header.stamp.sec, header.stamp.nanosec = source.sec, source.nanosec
    in_pixels = all(np.isnan(skeleton.points[:, 2]).all() for skeleton in found)
    if not in_pixels and source.frame not in ("", header.frame_id):
        raise ValueError(
            f"markers are in the frame {header.frame_id!r} and not in that of the camera, "
            f"{source.frame!r}; expected what the detector sends"
        )
    return poses(
        header,
        [_person(skeleton, in_pixels=in_pixels) for skeleton in found],
        layout="hiros",
        joint_names=JOINTS,
        metric=not in_pixels,
        project=not in_pixels,
    )


def _person(skeleton: SimpleNamespace, *, in_pixels: bool) -> SimpleNamespace:
    points, score = skeleton.points, skeleton.confidence
    place = {"keypoints": points[:, :2].ravel()} if in_pixels else {"joints": points.ravel()}
    return person(
        skeleton.id if skeleton.id >= 0 else NO_TRACK,
        score if np.isfinite(score) else 1.0,
        joint_scores=skeleton.scores,
        **place,
    )


def _decode_skeleton(cdr: CdrReader) -> SimpleNamespace:
    number, sec, nanosec, frame = cdr.int32(), cdr.int32(), cdr.uint32(), cdr.string()
    cdr.int32s(2)  # max_markers, max_links
    confidence = float(cdr.float64s(1)[0])
    cdr.float64s(_STATE + 3)  # bounding_box
    points, scores = _decode_markers(cdr)
    for _ in range(cdr.count(_LEAST_LINK)):
        cdr.int32()
        cdr.string()
        cdr.int32s(2)
        cdr.float64s(1 + _STATE)
    return SimpleNamespace(
        id=number,
        sec=sec,
        nanosec=nanosec,
        frame=frame,
        confidence=confidence,
        points=points,
        scores=scores,
    )


def _decode_markers(cdr: CdrReader) -> tuple[Float64Array, Float64Array]:
    """Return points (J, 3) and scores (J,) of all joints."""
    points, scores = np.full((len(JOINTS), 3), np.nan), np.zeros(len(JOINTS))
    unknown: list[str] = []
    for _ in range(n := cdr.count(_LEAST_MARKER)):
        cdr.int32()
        name, numbers = cdr.string(), cdr.float64s(1 + _STATE)
        if (place := _place_of(name)) is None:
            unknown.append(name)
            continue
        points[place], score = numbers[1:4], numbers[0]
        scores[place] = score if np.isfinite(score) else 1.0
    if n and len(unknown) == n:
        raise ValueError(
            f"markers named {', '.join(map(repr, unknown[:3]))}, none of which is a joint of ours; "
            "publish them by the names of a layout (left_knee, ...)"
        )
    return points, scores


@lru_cache(maxsize=1024)
def _place_of(name: str) -> int | None:
    """Return the number of a joint, whichever way its name is written: LeftKnee, KNEE_LEFT."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|[ -]", "_", name).lower().split("_")
    sides = [word for word in words if word in ("left", "right")]
    joint = "_".join([*sides, *(word for word in words if word not in sides)])
    joint = _SAME.get(joint, joint)
    return JOINTS.index(joint) if joint in JOINTS else None


HIROS_SKELETONS = MessageType(
    name=f"{_PACKAGE}/msg/SkeletonGroup",
    content=Content.POSES,
    definition=lambda: "std_msgs/Header header\nSkeleton[] skeletons\n",
    dependencies=(
        *(HEADER, TIME, POSE, POINT, QUATERNION, VECTOR3),
        Definition("geometry_msgs/Twist", lambda: _TWIST),
        Definition("geometry_msgs/Accel", lambda: _TWIST),
        *(Definition(f"{_PACKAGE}/{n}", partial(str, f)) for n, f in _FIELDS.items()),
    ),
    decode=_decode,
    info_topics=("depth/camera_info", "color/camera_info", "rgb/camera_info"),
    bytes_factor=20,
    install="clone https://github.com/HiROS-unipd/skeleton_msgs into a workspace and build it",
)
"""As Hi-ROS has it for ROS 2."""
