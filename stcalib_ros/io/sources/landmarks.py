"""Landmarks of MediaPipe's pose models, saved as NumPy arrays or tables; a file is a camera.

::

    SOURCE/CAMERA.npz     landmarks (F, 33, D) or (F, P, 33, D): x, y, z, visibility; NaN: nobody.
                          If known: frame (F,), timestamp_ms (F,), image_size (2,), fps
    SOURCE/CAMERA.csv     frame (or timestamp_ms), landmark, x, y, visibility: a row a landmark; or
                          frame, x0, y0, v0, x1, ... or frame, nose_x, nose_y, ...: a row a person

Positions are 0 to 1 across the image, or px. MediaPipe follows one person.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.io.files import head
from stcalib_ros.io.npz_files import names_in_npz, read_npz
from stcalib_ros.io.sources.cameras import (
    by_camera,
    fitting_files,
    looked_at,
    with_suffix,
)
from stcalib_ros.io.sources.form import (
    UNTRACKED,
    CameraPoses,
    Pose,
    PoseFormat,
    PoseSource,
    reading,
    whole_number,
)
from stcalib_ros.io.sources.images import all_images
from stcalib_ros.io.sources.tables import (
    FRAME,
    TIME,
    column_names,
    find_column,
    read_table,
    stamps_of,
)

_LAYOUT = LAYOUTS["blazepose_33"]
_J = _LAYOUT.n_joints
_LANDMARKS = ("landmarks", "pose_landmarks", "keypoints")
_LANDMARK = ("landmark", "landmark_id", "landmark_index", "landmark_name", "id", "joint")
_PERSON = ("person", "person_id", "pose", "pose_id")
_VISIBILITY = ("visibility", "v", "score", "presence")
_WIDE = re.compile(
    r"(?P<before>[xyv])_?(?P<number>\d+)|(?P<joint>\w+?)_(?P<after>x|y|v|visibility)"
)
_Z_AND_MORE = 3
"""Numbers of a landmark behind which its visibility is, count: x, y, z. Definition of MediaPipe."""
_MOST_NORMALISED = 2.0
"""Widths of the image. Positions that are mostly larger are px: landmarks outside of the image are
guessed, seldom by more than its width. Chosen."""


def is_mediapipe(path: Path, files: Sequence[Path]) -> bool:
    """Whether there are arrays or tables of 33 landmarks."""
    del path
    arrays = any(set(_LANDMARKS) & set(names_in_npz(file)) for file in looked_at(files, ".npz"))
    return arrays or any(_is_table(head(file)) for file in looked_at(files, ".csv"))


def _is_table(text: str) -> bool:
    columns = column_names(text.partition("\n")[0])
    by_row = find_column(columns, _LANDMARK) is not None and {"x", "y"} <= set(columns)
    return by_row or len(_wide(columns)) >= 2 * _J


def read_mediapipe(path: Path, files: Sequence[Path]) -> PoseSource:
    """Read the poses of all cameras.

    Raises
    ------
    InputError
        A file has another form.
    """
    fitting = with_suffix(files, ".npz") or fitting_files(files, ".csv", _is_table)
    cameras = []
    for name, file in by_camera(path, fitting).items():
        with reading(file, "landmarks of MediaPipe"):
            read = _array if file.suffix.lower() == ".npz" else _table
            cameras.append(read(name, file))
    all_xy = [pose.points[:, :2].ravel() for camera in cameras for pose in camera.poses]
    known = np.abs(np.concatenate([np.zeros(0), *all_xy]))
    known = known[known > 0]
    normalised = not len(known) or float(np.median(known)) <= _MOST_NORMALISED
    return PoseSource(path, tuple(cameras), _LAYOUT.name, normalised)


def _array(name: str, file: Path) -> CameraPoses:
    arrays = read_npz(file)
    key = next(key for key in (*_LANDMARKS, "") if key in arrays or not key)
    landmarks = np.asarray(arrays[key], dtype=np.float64)
    if landmarks.ndim not in (3, 4) or landmarks.shape[-2] != _J or landmarks.shape[-1] < 2:
        raise ValueError(f"{key} has shape {landmarks.shape}, expected (F, {_J}, 4)")
    followed = landmarks.ndim == 3
    people = landmarks[:, None] if followed else landmarks
    visible = people[..., _Z_AND_MORE:][..., :1]
    scores = visible if visible.shape[-1] else np.ones_like(people[..., :1])
    points = np.concatenate([people[..., :2], scores], axis=-1)
    numbers = np.array([whole_number(n) for n in arrays.get("frame", np.arange(len(people)))])
    time = find_column(arrays, TIME)
    stamps = None if time is None else stamps_of(time, [str(t) for t in arrays[time].tolist()])
    there = np.isfinite(points[..., :2]).all(-1).any(-1)
    poses = [
        Pose(int(numbers[f]), 0 if followed else UNTRACKED, points[f, p])
        for f, p in zip(*np.nonzero(there), strict=True)
    ]
    size = np.ravel(arrays["image_size"]).tolist() if "image_size" in arrays else None
    return CameraPoses(
        name,
        numbers,
        tuple(poses),
        None if stamps is None else np.array(stamps, dtype=np.int64),
        None if size is None else (whole_number(size[0]), whole_number(size[1])),
        fps=float(arrays["fps"]) if "fps" in arrays else None,
    )


def _table(name: str, file: Path) -> CameraPoses:
    table = read_table(file)
    frame, time = find_column(table, FRAME), find_column(table, TIME)
    n_rows = len(next(iter(table.values())))
    stamps = None if time is None else stamps_of(time, table[time])
    wide = _wide(list(table))
    if frame is not None:
        frames = np.array([whole_number(text) for text in table[frame]])
    elif stamps is not None:
        frames = np.unique(stamps, return_inverse=True)[1].ravel()
    else:
        frames = np.arange(n_rows)
    person = find_column(table, _PERSON)
    people = [whole_number(text) for text in table[person]] if person else [0] * n_rows
    poses = _of_wide(table, wide, frames, people) if wide else _of_rows(table, frames, people)
    if stamps is None:
        return CameraPoses(name, all_images([pose.image for pose in poses], file), poses)
    images, first = np.unique(frames, return_index=True)
    return CameraPoses(name, images, poses, np.array(stamps, dtype=np.int64)[first])


def _wide(columns: Sequence[str]) -> dict[str, tuple[int, int]]:
    """Joint and place (x, y, score) of the columns of a table with a row for each person."""
    found: dict[str, tuple[int, int]] = {}
    for column in columns:
        match = _WIDE.fullmatch(column)
        if match is None:
            continue
        place = "xyv".index((match["before"] or match["after"])[0])
        if match["number"] is not None:
            found[column] = int(match["number"]), place
        elif match["joint"] in _LAYOUT.joint_names:
            found[column] = _LAYOUT.index(match["joint"]), place
    first = 1 if found and min(joint for joint, _ in found.values()) == 1 else 0
    return {c: (joint - first, k) for c, (joint, k) in found.items() if joint - first < _J}


def _numbers(values: Sequence[str]) -> Float64Array:
    """Numbers of a column; NaN where it is empty."""
    return np.array([float(value) if value.strip() else np.nan for value in values])


def _of_wide(
    table: Mapping[str, list[str]],
    wide: Mapping[str, tuple[int, int]],
    frames: IntArray,
    people: Sequence[int],
) -> tuple[Pose, ...]:
    points = np.zeros((len(frames), _J, 3))
    points[..., 2] = 1.0
    for column, (joint, place) in wide.items():
        points[:, joint, place] = _numbers(table[column])
    rows = np.flatnonzero(np.isfinite(points[..., :2]).all(-1).any(-1))
    return tuple(Pose(int(frames[k]), people[int(k)], points[k]) for k in rows)


def _of_rows(
    table: Mapping[str, list[str]], frames: IntArray, people: Sequence[int]
) -> tuple[Pose, ...]:
    column, score = find_column(table, _LANDMARK), find_column(table, _VISIBILITY)
    joints = [_joint(text) for text in table[column or "landmark"]]
    scores = _numbers(table[score]) if score else np.ones(len(joints))
    xyv = np.c_[_numbers(table["x"]), _numbers(table["y"]), scores]
    keys, place = np.unique(np.c_[frames, people], axis=0, return_inverse=True)
    points = np.zeros((len(keys), _J, 3))
    points[place.ravel(), joints] = xyv
    return tuple(Pose(int(f), int(i), p) for (f, i), p in zip(keys, points, strict=True))


def _joint(text: str) -> int:
    """Index of a landmark by its number or name, such as 0, NOSE or PoseLandmark.NOSE."""
    name = text.strip().lower().rpartition(".")[2]
    joint = int(name) if name.isdecimal() else _LAYOUT.index(name)
    if joint >= _J:
        raise ValueError(f"landmark {joint}: the pose has {_J}")
    return joint


MEDIAPIPE = PoseFormat(
    "landmarks of MediaPipe's pose models: CAMERA.npz or CAMERA.csv", is_mediapipe, read_mediapipe
)
