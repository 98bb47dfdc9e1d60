"""Recordings as the packages of others publish them, encoded by an encoder that is not ours."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from bag_helpers import CAMERA_INFO, Message, header, info, write_bag

from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.model.arrays import FloatArray
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.io.bag import read_bag

Persons = list["Seen"]
MakeMessage = Callable[[CameraRecording, dict[str, Any], Persons], dict[str, Any]]


ZED_BODY_34 = (
    *("pelvis", "navel", "chest", "neck"),
    *("left_collar", "left_shoulder", "left_elbow", "left_wrist"),
    *("left_hand", "left_hand_tip", "left_thumb"),
    *("right_collar", "right_shoulder", "right_elbow", "right_wrist"),
    *("right_hand", "right_hand_tip", "right_thumb"),
    *("left_hip", "left_knee", "left_ankle", "left_foot"),
    *("right_hip", "right_knee", "right_ankle", "right_foot"),
    *("head", "nose", "left_eye", "left_ear", "right_eye", "right_ear"),
    *("left_heel", "right_heel"),
)
ZED_FORMATS = (LAYOUTS["coco_18"].joint_names, ZED_BODY_34, LAYOUTS["body_38"].joint_names)
KINECT = ZED_BODY_34[:-2]


class Seen(NamedTuple):
    """A person in an image: keypoints and joints by the names of those that were observed."""

    track_id: int
    keypoints: dict[str, FloatArray]
    joints: dict[str, FloatArray]


def assert_read(bag: Path, given: Recording, **expected: Any) -> Recording:
    """Read a bag; poses are those that were given, joint by joint, and unknown elsewhere.

    Parameters
    ----------
    bag : Path
    given : Recording
    expected : object
        Attributes that all cameras have, ``joint_names``, which of them are ``sent``, if not all,
        and whether keypoints are ``exact``: not projected from joints in float32.
    """
    exact = expected.pop("exact", True)
    names = expected.pop("joint_names")
    sent = expected.pop("sent", names)
    found = read_bag(bag)
    for before, after in zip(given.cameras, found.cameras, strict=True):
        assert (after.name, after.frame_id) == (before.name, before.frame_id)
        assert after.layout.joint_names == tuple(names)
        assert {name: getattr(after, name) for name in expected} == expected
        np.testing.assert_allclose(after.stamps, before.stamps, atol=1e-9)
        assert [t.track_id for t in after.tracks] == [t.track_id for t in before.tracks]
        for a, b in zip(before.tracks, after.tracks, strict=True):
            np.testing.assert_array_equal(b.frames, a.frames)
            joints = a.joints if after.has_3d_poses else np.full_like(a.joints, np.nan)
            for column, name in enumerate(names):
                if name not in sent or name not in before.layout.joint_names:
                    assert np.isnan(b.keypoints[:, column]).all()
                    assert np.isnan(b.joints[:, column]).all()
                    continue
                own = before.layout.index(name)
                seen = np.isfinite(a.keypoints[:, own]).all(-1, keepdims=True)
                np.testing.assert_allclose(
                    b.keypoints[:, column], a.keypoints[:, own], atol=1e-9 if exact else 1e-3
                )
                np.testing.assert_allclose(
                    b.joints[:, column], np.where(seen, joints[:, own], np.nan), atol=1e-6
                )
    return found


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
    """Write a bag of messages of one type.

    ``{}`` in the topics is the name of the camera; with ``{id}`` every person has a topic.
    """
    return write_bag(
        path,
        foreign_messages(recording, kind=kind, topic=topic, info_topic=info_topic, make=make),
    )


def foreign_messages(
    recording: Recording, *, kind: str, topic: str, info_topic: str, make: MakeMessage
) -> list[Message]:
    """Return what `write_foreign` writes."""
    messages: list[Message] = []
    for camera in recording.cameras:
        lens = camera.intrinsics
        messages.append(
            (
                info_topic.format(camera.name),
                CAMERA_INFO,
                info(
                    header=header(recording.epoch_ns, camera.frame_id),
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
            parts = [[one] for one in persons] if "{id}" in topic else [persons]
            for part in parts:
                message = make(camera, header(stamp_ns, camera.frame_id), part)
                own = topic.format(camera.name, id=part[0].track_id if part else "")
                messages.append((own, kind, message, stamp_ns))
    return messages


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


def zed(form: int, **changes: Any) -> MakeMessage:
    """A ``zed_msgs/ObjectsStamped`` of bodies of a format, by its number."""

    def make(camera: CameraRecording, stamped: dict[str, Any], persons: Persons) -> dict[str, Any]:
        frame = camera.frame_id.removesuffix("_optical")
        bodies = [zed_body(p, ZED_FORMATS[form], form) | changes for p in persons]
        return {"header": stamped | {"frame_id": frame}, "objects": bodies}

    return make


def kinect(camera: CameraRecording, stamped: dict[str, Any], persons: Persons) -> dict[str, Any]:
    """A ``visualization_msgs/MarkerArray`` of an Azure Kinect."""
    return {
        "markers": [
            joint_marker(stamped, 100 * seen.track_id + KINECT.index(name), point)
            for seen in persons
            for name, point in seen.joints.items()
            if name in KINECT
        ]
    }


HRI = (
    *("nose", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder"),
    *("left_elbow", "left_wrist", "right_hip", "right_knee", "right_ankle", "left_hip"),
    *("left_knee", "left_ankle", "left_eye", "right_eye", "left_ear", "right_ear"),
)


def hri(camera: CameraRecording, stamped: dict[str, Any], persons: Persons) -> dict[str, Any]:
    """A ``hri_msgs/Skeleton2D`` of one person; joints that are not there are at (0, 0)."""
    (seen,) = persons
    nothing = {"x": 0.0, "y": 0.0, "c": 0.0}
    width, height = camera.intrinsics.width, camera.intrinsics.height
    return {
        "header": stamped,
        "skeleton": [
            {
                "x": (seen.keypoints[name][0] + 0.5) / width,
                "y": (seen.keypoints[name][1] + 0.5) / height,
                "c": 0.9,
            }
            if name in seen.keypoints
            else nothing
            for name in HRI
        ],
    }


def hiros(n_axes: int, **changes: Any) -> MakeMessage:
    """A ``hiros_skeleton_msgs/SkeletonGroup``, sent later; two axes: in pixels."""

    def make(camera: CameraRecording, stamped: dict[str, Any], persons: Persons) -> dict[str, Any]:
        sent = stamped | {"stamp": stamped["stamp"] | {"nanosec": 7}}
        bodies = [hiros_skeleton(stamped, seen, n_axes) | changes for seen in persons]
        return {"header": sent, "skeletons": bodies}

    return make


def hiros_skeleton(
    stamped: dict[str, Any],
    seen: Seen,
    n_axes: int,
    named: Callable[[str], str] = str.upper,
) -> dict[str, Any]:
    """Markers named as LEFT_KNEE; pixels have no z."""
    places = seen.joints if n_axes > len(("x", "y")) else seen.keypoints
    places = {name: np.append(place, np.nan)[:3] for name, place in places.items()}
    return {
        "id": seen.track_id,
        "src_time": stamped["stamp"],
        "src_frame": stamped["frame_id"],
        "max_markers": 32,
        "max_links": 31,
        "confidence": np.nan,
        "bounding_box": {"center": at([np.nan] * 3), "height": 0.0, "length": 0.0, "width": 0.0},
        "markers": [
            {"id": number, "name": named(name), "confidence": 0.9, "center": at(place)}
            for number, (name, place) in enumerate(places.items())
        ],
        "links": [
            {
                "id": 0,
                "name": "thigh",
                "parent_marker": 1,
                "child_marker": 2,
                "confidence": 0.9,
                "center": at([np.nan] * 3),
            }
        ],
    }


def at(place: Sequence[float] | FloatArray) -> dict[str, Any]:
    """A kinematic state of which only the place is known."""
    unknown = dict.fromkeys("xyz", np.nan)
    moving = {"linear": unknown, "angular": unknown}
    position = dict(zip("xyz", map(float, place), strict=True))
    pose = {"position": position, "orientation": unknown | {"w": np.nan}}
    return {"pose": pose, "velocity": moving, "acceleration": moving}


def hri_ids(recording: Recording, topic: str) -> list[Message]:
    """``hri_msgs/IdsList`` of every image."""
    messages: list[Message] = []
    for camera in recording.cameras:
        for stamp, persons in zip(camera.stamps, images_of(camera), strict=True):
            stamp_ns = recording.epoch_ns + round(stamp * 1e9)
            message = {"header": header(stamp_ns, ""), "ids": [str(p.track_id) for p in persons]}
            messages.append((topic.format(camera.name), "hri_msgs/msg/IdsList", message, stamp_ns))
    return messages


def seen_in_depth(recording: Recording) -> Recording:
    """The recording with joints at places before the camera, and keypoints where they are seen."""
    cameras = []
    for camera in recording.cameras:
        lens, tracks = camera.intrinsics, []
        for track in camera.tracks:
            joints = track.joints + np.array([0.0, 0.0, 8.0])
            tracks.append(replace(track, joints=joints, keypoints=project(joints, lens)))
        cameras.append(replace(camera, tracks=tuple(tracks)))
    return replace(recording, cameras=tuple(cameras))


def joint_marker(stamped: dict[str, Any], number: int, point: FloatArray) -> dict[str, Any]:
    xyz, color = dict.fromkeys("xyz", 0.0), dict.fromkeys("rgba", 1.0)
    return {
        "header": stamped,
        "ns": "",
        "id": number,
        "type": 2,
        "action": 0,
        "pose": {
            "position": dict(zip("xyz", map(float, point), strict=True)),
            "orientation": xyz | {"w": 1.0},
        },
        "scale": xyz,
        "color": color,
        "lifetime": {"sec": 0, "nanosec": 250_000_000},
        "frame_locked": False,
        "points": [],
        "colors": [],
        "texture_resource": "",
        "texture": {"header": stamped, "format": "", "data": []},
        "uv_coordinates": [],
        "text": "",
        "mesh_resource": "",
        "mesh_file": {"filename": "", "data": []},
        "mesh_use_embedded_materials": False,
    }


def zed_body(seen: Seen, order: Sequence[str], body_format: int) -> dict[str, Any]:
    """Joints that were not observed are NaN, as in the SDK; unused slots are 0."""
    pixels, points = np.zeros((70, 2)), np.zeros((70, 3))
    pixels[: len(order)], points[: len(order)] = np.nan, np.nan
    for slot, name in enumerate(order):
        if name in seen.keypoints:
            pixels[slot] = seen.keypoints[name]
            x, y, z = seen.joints[name]
            points[slot] = z, -x, -y
    corners3, corners2 = {"corners": [{"kp": [0.0] * 3}] * 8}, {"corners": [{"kp": [0.0] * 2}] * 4}
    return {
        "label": f"Body_{seen.track_id}",
        "label_id": seen.track_id,
        "sublabel": "",
        "confidence": 49.5,
        "position": [0.0] * 3,
        "position_covariance": [0.0] * 6,
        "velocity": [0.0] * 3,
        "tracking_available": True,
        "tracking_state": 1,
        "action_state": 0,
        "bounding_box_2d": {"corners": [{"kp": [0, 0]}] * 4},
        "bounding_box_3d": corners3,
        "dimensions_3d": [0.0] * 3,
        "skeleton_available": True,
        "body_format": body_format,
        "head_bounding_box_2d": corners2,
        "head_bounding_box_3d": corners3,
        "head_position": [0.0] * 3,
        "skeleton_2d": {"keypoints": [{"kp": row} for row in pixels.tolist()]},
        "skeleton_3d": {"keypoints": [{"kp": row} for row in points.tolist()]},
    }
