"""Recordings as the packages of others publish them, encoded by an encoder that is not ours."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from bag_helpers import CAMERA_INFO, Message, header, info, write_bag

from stcalib_ros.core.model.arrays import FloatArray
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.core.model.recording import CameraRecording, Recording

Persons = list["Seen"]
MakeMessage = Callable[[CameraRecording, dict[str, Any], Persons], dict[str, Any]]


class Seen(NamedTuple):
    """A person in an image: keypoints and joints by the names of those that were observed."""

    track_id: int
    keypoints: dict[str, FloatArray]
    joints: dict[str, FloatArray]


def images_of(camera: CameraRecording) -> Iterator[Persons]:
    """Persons of every image."""
    names = camera.layout.joint_names
    rows: list[Persons] = [[] for _ in camera.stamps]
    for track in camera.tracks:
        for frame, points, joints in zip(track.frames, track.keypoints, track.joints, strict=True):
            seen = [j for j in range(len(names)) if np.isfinite(points[j]).all()]
            rows[frame].append(
                Seen(
                    track.track_id,
                    {names[j]: points[j] for j in seen},
                    {names[j]: joints[j] for j in seen},
                )
            )
    yield from rows


def write_foreign(
    path: Path,
    recording: Recording,
    *,
    kind: str,
    topic: str,
    info_topic: str,
    make: MakeMessage,
) -> Path:
    """Write a bag of messages of one type; ``{}`` in the topics is the name of the camera."""
    messages: list[Message] = []
    for camera in recording.cameras:
        lens = camera.intrinsics
        messages.append(
            (
                info_topic.format(camera.name),
                CAMERA_INFO,
                info(
                    width=lens.width,
                    height=lens.height,
                    k=lens.K.ravel().tolist(),
                    p=np.hstack([lens.K, np.zeros((3, 1))]).ravel().tolist(),
                    d=lens.D.tolist(),
                ),
                recording.epoch_ns,
            )
        )
        for stamp, persons in zip(camera.stamps, images_of(camera), strict=True):
            stamp_ns = recording.epoch_ns + round(stamp * 1e9)
            message = make(camera, header(stamp_ns, camera.frame_id), persons)
            messages.append((topic.format(camera.name), kind, message, stamp_ns))
    return write_bag(path, messages)


def yolo(camera: CameraRecording, stamped: dict[str, Any], persons: Persons) -> dict[str, Any]:
    """A ``yolo_msgs/DetectionArray`` of the tracking node, with a chair."""
    chair = detection("7", {}, class_id=56, class_name="chair")
    return {
        "header": stamped,
        "detections": [chair, *(detection(str(p.track_id), p.keypoints) for p in persons)],
    }


def untracked_yolo(
    camera: CameraRecording, stamped: dict[str, Any], persons: Persons
) -> dict[str, Any]:
    """A ``yolo_msgs/DetectionArray`` of the detecting node alone."""
    return {"header": stamped, "detections": [detection("", p.keypoints) for p in persons]}


def detection(track: str, keypoints: dict[str, FloatArray], **changes: Any) -> dict[str, Any]:
    order = LAYOUTS["coco_17"].joint_names
    pose = {
        "position": dict.fromkeys("xyz", 0.0),
        "orientation": dict.fromkeys("xyz", 0.0) | {"w": 1.0},
    }
    return {
        "class_id": 0,
        "class_name": "person",
        "score": 0.75,
        "id": track,
        "bbox": {
            "center": {"position": {"x": 1.0, "y": 2.0}, "theta": 0.0},
            "size": {"x": 3.0, "y": 4.0},
        },
        "bbox3d": {"center": pose, "size": dict.fromkeys("xyz", 1.0), "frame_id": ""},
        "mask": {"height": 4, "width": 5, "data": [{"x": 1.0, "y": 2.0}]},
        "keypoints": {
            "data": [
                {
                    "id": order.index(name) + 1,
                    "point": {"x": float(u), "y": float(v)},
                    "score": 0.5,
                }
                for name, (u, v) in keypoints.items()
                if name in order
            ]
        },
        "keypoints3d": {"data": [], "frame_id": "base_link"},
    } | changes
