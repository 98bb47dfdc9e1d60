"""``yolo_msgs/DetectionArray`` of yolo_ros: what an Ultralytics model finds in one image.

Keypoints are those of COCO, numbered from 1, and only those that were detected are sent. The id is
text, and empty where the tracking node does not run. 3D keypoints are read from a depth image and
given in a frame of the robot; they are not used. Detections without keypoints are no persons.
"""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace

import numpy as np

from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
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
from stcalib_ros.io.message_types.pose_content import person, poses, track_id_of

_LAYOUT = LAYOUTS["coco_17"]
_DEFINITION = "std_msgs/Header header\n{package}/Detection[] detections\n"
_FIELDS = {
    "Detection": (
        "int32 class_id\nstring class_name\nfloat64 score\nstring id\n"
        "{package}/BoundingBox2D bbox\n{package}/BoundingBox3D bbox3d\n{package}/Mask mask\n"
        "{package}/KeyPoint2DArray keypoints\n{package}/KeyPoint3DArray keypoints3d\n"
    ),
    "BoundingBox2D": "{package}/Pose2D center\n{package}/Vector2 size\n",
    "Pose2D": "{package}/Point2D position\nfloat64 theta\n",
    "Point2D": "float64 x\nfloat64 y\n",
    "Vector2": "float64 x\nfloat64 y\n",
    "BoundingBox3D": ("geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\nstring frame_id\n"),
    "Mask": "int32 height\nint32 width\n{package}/Point2D[] data\n",
    "KeyPoint2DArray": "{package}/KeyPoint2D[] data\n",
    "KeyPoint2D": "int32 id\n{package}/Point2D point\nfloat64 score\n",
    "KeyPoint3DArray": "{package}/KeyPoint3D[] data\nstring frame_id\n",
    "KeyPoint3D": "int32 id\ngeometry_msgs/Point point\nfloat64 score\n",
}
_LEAST_DETECTION, _LEAST_POINT, _LEAST_KEYPOINT = 100, 16, 28
"""Bytes that a detection, a point and a keypoint take at least. By definition of the message."""


def _decode(cdr: CdrReader) -> SimpleNamespace:
    header = decode_header(cdr)
    found = [_decode_detection(cdr) for _ in range(cdr.count(_LEAST_DETECTION))]
    return poses(header, [one for one in found if one is not None], layout=_LAYOUT.name)


def _decode_detection(cdr: CdrReader) -> SimpleNamespace | None:
    cdr.int32()  # class_id
    cdr.string()  # class_name
    score, track_id = float(cdr.float64s(1)[0]), track_id_of(cdr.string())
    cdr.float64s(15)  # bbox, and bbox3d up to its frame_id
    cdr.string()
    cdr.int32s(2)  # mask
    cdr.float64s(2 * cdr.count(_LEAST_POINT))
    keypoints = np.full((_LAYOUT.n_joints, 2), np.nan)
    scores = np.zeros(_LAYOUT.n_joints)
    n_keypoints = cdr.count(_LEAST_KEYPOINT)
    for _ in range(n_keypoints):
        number, (x, y, keypoint_score) = cdr.int32(), cdr.float64s(3)
        if not 1 <= number <= _LAYOUT.n_joints:
            raise ValueError(
                f"keypoint {number}: a model of people has 1 to {_LAYOUT.n_joints}, COCO's"
            )
        keypoints[number - 1], scores[number - 1] = (x, y), keypoint_score
    for _ in range(cdr.count(_LEAST_KEYPOINT)):  # keypoints3d
        cdr.int32()
        cdr.float64s(4)
    cdr.string()
    if n_keypoints == 0:
        return None
    return person(track_id, score, keypoints=keypoints.ravel(), joint_scores=scores)


def _of_package(package: str) -> MessageType:
    def text(fields: str) -> str:
        return fields.format(package=package)

    return MessageType(
        name=f"{package}/msg/DetectionArray",
        content=Content.POSES,
        definition=lambda: text(_DEFINITION),
        dependencies=(
            *(HEADER, TIME, POSE, POINT, QUATERNION, VECTOR3),
            *(Definition(f"{package}/{n}", partial(text, f)) for n, f in _FIELDS.items()),
        ),
        decode=_decode,
        topics=("tracking", "detections_3d", "detections"),
        node=("yolo",),
        info_topics=("color/camera_info", "rgb/camera_info"),
        bytes_factor=8,
        install="clone https://github.com/mgonzs13/yolo_ros into a workspace and build it",
    )


YOLO_DETECTIONS = _of_package("yolo_msgs")
"""As yolo_ros has it since 4.0."""

YOLOV8_DETECTIONS = _of_package("yolov8_msgs")
"""The same messages by the name that the package had up to 3.4."""
