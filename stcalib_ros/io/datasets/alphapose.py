"""Poses of AlphaPose (2D, tracked) and MotionBERT (3D), camera by camera.

::

    POSES/CAMERA/alphapose-results.json     a list of persons: image_id, keypoints, idx, box
    POSES/CAMERA/IDX/X3D.npy                MotionBERT's output for the person ``--focus IDX``,
                                            for all of them or for nobody

AlphaPose numbers images from 0 (``0.jpg``); the number is that of the frame of the data set.
MotionBERT gives one pose for every appearance of a person in the list, in its order: 17 joints in
Human3.6M's order, x right, y down, z forward, scaled by the image. The keypoints are converted to
these joints as MotionBERT does it, from Halpe's 26 (or 136) or from COCO's 17. Without MotionBERT
they stay what they are; of Halpe's 136, the 26 of the body are used.
"""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS, Layout
from stcalib_ros.io.datasets.form import Dataset, Detections
from stcalib_ros.io.json_files import MALFORMED, read_json
from stcalib_ros.io.limits import MIN_BOX_OVERLAP, MIN_COMMON_JOINTS, SAME_PERSON
from stcalib_ros.io.npz_files import read_npy

_MOTIONBERT = LAYOUTS["h36m_17"]
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

_DETECTED = {17: LAYOUTS["coco_17"], 26: LAYOUTS["halpe_26"], 136: LAYOUTS["halpe_26"]}
"""Layouts of keypoints that nobody lifted, by their number."""


def pose_detections(dataset: Dataset, poses: Path) -> Detections:
    """Tracked 2D poses, with their 3D poses if there are any, of all cameras of a data set.

    Who a detection truly is follows from the true 3D joints of the data set, or from its boxes.

    Raises
    ------
    InputError
        A file is missing or has another form.
    """
    lifted = any(any((poses / name).glob("*/X3D.npy")) for name in dataset.names)
    rows = [row for c in range(len(dataset.names)) for row in _camera(dataset, poses, c, lifted)]
    if not rows:
        raise InputError(f"{poses} has no pose in the frames that {dataset.path} has")
    layouts = {row.layout.name: row.layout for row in rows}
    if len(layouts) > 1:
        raise InputError(f"{poses} has poses of {' and '.join(layouts)}: run one model on all")
    layout = rows[0].layout
    return Detections(
        frame=np.array([row.frame for row in rows]),
        camera=np.array([row.camera for row in rows]),
        track=np.array([row.track for row in rows]),
        person=np.array([_person(dataset, row) for row in rows]),
        kp2d=np.stack([row.kp2d for row in rows]),
        kp3d=np.stack([row.kp3d for row in rows]) if lifted else None,
        joint_names=layout.joint_names,
        metric=False,
    )


class _Detection(NamedTuple):
    """One pose; its 3D pose is empty where nobody lifted it."""

    frame: int
    camera: int
    track: int
    layout: Layout
    kp2d: Float64Array
    kp3d: Float64Array


def _camera(dataset: Dataset, poses: Path, c: int, lifted: bool) -> list[_Detection]:
    folder = poses / dataset.names[c]
    path = folder / "alphapose-results.json"
    results = read_json(path)
    index = {int(n): f for f, n in enumerate(dataset.frame_number)}
    try:
        rows = []
        for track, items in _by_track(results).items():
            X_3d = _lifted(folder, track, len(items)) if lifted else np.zeros((len(items), 0, 3))
            for pose, item in zip(X_3d, items, strict=True):
                frame = index.get(_frame_number(item["image_id"]))
                if frame is None:
                    continue
                layout, kp2d = _keypoints(item["keypoints"], lifted)
                rows.append(_Detection(frame, c, track, layout, kp2d, pose))
    except MALFORMED as error:
        raise InputError(
            f"{path} is not a result of AlphaPose ({type(error).__name__}: {error})"
        ) from error
    return rows


def _keypoints(flat: list[float], lifted: bool) -> tuple[Layout, Float64Array]:
    """Return layout and keypoints (J, 3) of a detection: of what was lifted, or as they are."""
    return (_MOTIONBERT, h36m_keypoints(flat)) if lifted else detected_keypoints(flat)


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
    if not path.exists():
        raise InputError(
            f"no such file: {path}: run MotionBERT with --focus {track} on {folder.name}"
        )
    X_3d = read_npy(path)
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


def detected_keypoints(flat: list[float]) -> tuple[Layout, Float64Array]:
    """Return layout and keypoints (J, 3) of a detection: x, y, score."""
    given = _given_keypoints(flat)
    layout = _DETECTED[len(given)]
    body = given[: layout.n_joints].copy()
    body[:, 2] = np.clip(body[:, 2], 0.0, 1.0)
    return layout, body


def _given_keypoints(flat: list[float]) -> Float64Array:
    given = np.array(flat, dtype=float).reshape(-1, 3)
    if len(given) not in _DETECTED:
        raise InputError(f"{len(given)} keypoints: expected COCO's 17 or Halpe's 26 or 136")
    return given


def h36m_keypoints(flat: list[float]) -> Float64Array:
    """Keypoints (17, 3) in Human3.6M's order: x, y, and the lowest score of the joints used."""
    given = _given_keypoints(flat)
    sources_of = _SOURCES[len(given)]
    out = np.zeros((len(sources_of), 3))
    for joint, sources in enumerate(sources_of):
        used = given[list(sources)]
        out[joint] = *used[:, :2].mean(0), np.clip(used[:, 2].min(), 0.0, 1.0)
    return out


def _person(dataset: Dataset, found: _Detection) -> int:
    """Number of the true person; -1 where nobody is near."""
    if dataset.joint_names:
        return _nearest_pose(dataset, found)
    return _nearest_box(dataset, found.frame, found.camera, found.kp2d)


def _nearest_pose(dataset: Dataset, found: _Detection) -> int:
    own, camera = found.layout, found.camera
    common = [n for n in own.joint_names if n in dataset.joint_names and n != "neck"]
    mine = found.kp2d[[own.index(n) for n in common], :2]
    joints = dataset.joints_world[found.frame][:, [dataset.joint_names.index(n) for n in common]]
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
