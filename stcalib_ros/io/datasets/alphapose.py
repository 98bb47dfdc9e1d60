"""Poses of AlphaPose (2D, tracked) and MotionBERT (3D), camera by camera.

::

    POSES/CAMERA/alphapose-results.json     a list of persons: image_id, keypoints, idx, box
    POSES/CAMERA/IDX/X3D.npy                MotionBERT's output for the person ``--focus IDX``

AlphaPose numbers images from 0 (``0.jpg``); the number is that of the frame of the data set.
MotionBERT gives one pose for every appearance of a person in the list, in its order: 17 joints in
Human3.6M's order, x right, y down, z forward, scaled by the image. The keypoints are converted to
these joints as MotionBERT does it, from Halpe's 26 (or 136) or from COCO's 17.
"""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.io.datasets.form import Dataset, Detections, read_json
from stcalib_ros.io.limits import MIN_BOX_OVERLAP, MIN_COMMON_JOINTS, SAME_PERSON

_LAYOUT = LAYOUTS["h36m_17"]
_HALPE = (
    *((19,), (12,), (14,), (16,), (11,), (13,), (15,), (18, 19), (18,)),
    *((0,), (17,), (5,), (7,), (9,), (6,), (8,), (10,)),
)
_COCO = (
    *((11, 12), (12,), (14,), (16,), (11,), (13,), (15,), (5, 6, 11, 12), (5, 6)),
    *((0,), (1, 2), (5,), (7,), (9,), (6,), (8,), (10,)),
)
"""For each joint of Human3.6M the joints whose middle it is."""

_SOURCES = {17: _COCO, 26: _HALPE, 136: _HALPE}
"""The same by the number of keypoints."""


def pose_detections(dataset: Dataset, poses: Path) -> Detections:
    """Tracked 2D poses with their 3D poses of all cameras of a data set.

    Who a detection truly is follows from the true 3D joints of the data set, or from its boxes.

    Raises
    ------
    InputError
        A file is missing or has another form.
    """
    parts = [_camera(dataset, poses, c) for c in range(len(dataset.names))]
    frame, camera, track, kp2d, kp3d = (np.concatenate(p) for p in zip(*parts, strict=True))
    if not len(frame):
        raise InputError(f"{poses} has no pose in the frames that {dataset.path} has")
    person = np.array(
        [_person(dataset, *key) for key in zip(frame, camera, kp2d, strict=True)], dtype=np.int64
    )
    return Detections(frame, camera, track, person, kp2d, kp3d, _LAYOUT.joint_names, metric=False)


def _camera(
    dataset: Dataset, poses: Path, c: int
) -> tuple[IntArray, IntArray, IntArray, Float64Array, Float64Array]:
    folder = poses / dataset.names[c]
    path = folder / "alphapose-results.json"
    results = read_json(path)
    index = {int(n): f for f, n in enumerate(dataset.frame_number)}
    try:
        people = _by_track(results)
        rows = []
        for track, items in people.items():
            X_3d = _lifted(folder, track, len(items))
            for pose, item in zip(X_3d, items, strict=True):
                frame = index.get(_frame_number(item["image_id"]))
                if frame is not None:
                    rows.append((frame, track, h36m_keypoints(item["keypoints"]), pose))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path} is not a result of AlphaPose ({type(error).__name__}: {error})"
        ) from error
    return (
        np.array([r[0] for r in rows], dtype=np.int64),
        np.full(len(rows), c, dtype=np.int64),
        np.array([r[1] for r in rows], dtype=np.int64),
        np.array([r[2] for r in rows], dtype=float).reshape(-1, 17, 3),
        np.array([r[3] for r in rows], dtype=float).reshape(-1, 17, 3),
    )


def _by_track(results: list[dict[str, Any]]) -> dict[int, list[dict[str, Any]]]:
    """Entries of each tracked person; AlphaPose writes ``idx`` as a number or in a list."""
    people: dict[int, list[dict[str, Any]]] = defaultdict(list)
    for item in results:
        if "idx" not in item:
            raise InputError("AlphaPose was run without tracking: run it with --pose_track")
        people[int(np.ravel(item["idx"])[0])].append(item)
    return people


def _lifted(folder: Path, track: int, n: int) -> Float64Array:
    path = folder / str(track) / "X3D.npy"
    try:
        X_3d = np.load(path, allow_pickle=False)
    except FileNotFoundError:
        raise InputError(
            f"no such file: {path}: run MotionBERT with --focus {track} on {folder.name}"
        ) from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path} is not a readable .npy file: {error}") from error
    if X_3d.shape != (n, 17, 3):
        raise InputError(
            f"{path} has shape {X_3d.shape}, expected ({n}, 17, 3): one pose for every appearance "
            f"of person {track} in alphapose-results.json"
        )
    return np.asarray(X_3d, dtype=np.float64)


def _frame_number(image_id: str | int) -> int:
    digits = re.findall(r"\d+", Path(str(image_id)).stem)
    if not digits:
        raise InputError(f"image_id {image_id!r} has no frame number")
    return int(digits[-1])


def h36m_keypoints(flat: list[float]) -> Float64Array:
    """Keypoints (17, 3) in Human3.6M's order: x, y, and the lowest score of the joints used."""
    given = np.array(flat, dtype=float).reshape(-1, 3)
    if len(given) not in _SOURCES:
        raise InputError(f"{len(given)} keypoints: expected COCO's 17 or Halpe's 26 or 136")
    sources_of = _SOURCES[len(given)]
    out = np.zeros((len(sources_of), 3))
    for joint, sources in enumerate(sources_of):
        used = given[list(sources)]
        out[joint] = *used[:, :2].mean(0), np.clip(used[:, 2].min(), 0.0, 1.0)
    return out


def _person(dataset: Dataset, frame: int, camera: int, kp2d: Float64Array) -> int:
    """Number of the true person; -1 where nobody is near."""
    if dataset.joint_names:
        return _nearest_pose(dataset, frame, camera, kp2d)
    return _nearest_box(dataset, frame, camera, kp2d)


def _nearest_pose(dataset: Dataset, frame: int, camera: int, kp2d: Float64Array) -> int:
    common = [n for n in _LAYOUT.joint_names if n in dataset.joint_names and n != "neck"]
    mine = kp2d[[_LAYOUT.index(n) for n in common], :2]
    joints = dataset.joints_world[frame][:, [dataset.joint_names.index(n) for n in common]]
    true = project(joints @ dataset.R[camera].T + dataset.t[camera], dataset.lens(camera))
    distance = np.linalg.norm(true - mine, axis=-1)
    known = np.isfinite(distance).sum(-1) >= MIN_COMMON_JOINTS
    if not known.any():
        return -1
    medians = np.full(len(distance), np.inf)
    medians[known] = np.nanmedian(distance[known], axis=-1)
    best = int(medians.argmin())
    return best if medians[best] <= SAME_PERSON * float(np.ptp(mine[:, 1])) else -1


def _nearest_box(dataset: Dataset, frame: int, camera: int, kp2d: Float64Array) -> int:
    boxes = dataset.boxes[(dataset.boxes[:, 0] == frame) & (dataset.boxes[:, 1] == camera)]
    if not len(boxes):
        return -1
    low, high = kp2d[:, :2].min(0), kp2d[:, :2].max(0)
    left, right = np.maximum(boxes[:, 3:5], low), np.minimum(boxes[:, 5:7], high)
    shared = np.prod(np.maximum(right - left, 0.0), axis=1)
    union = np.prod(high - low) + np.prod(boxes[:, 5:7] - boxes[:, 3:5], axis=1) - shared
    overlap = shared / np.maximum(union, 1e-9)
    best = int(overlap.argmax())
    return int(boxes[best, 2]) if overlap[best] >= MIN_BOX_OVERLAP else -1
