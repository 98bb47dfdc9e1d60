"""A Caliscope project, a recording in it, or the table of its 2D points.

::

    PROJECT/camera_array.toml                         lenses
    PROJECT/recordings/walk/timestamps.csv            cam_id, frame_time
    PROJECT/recordings/walk/TRACKER/xy_TRACKER.csv    sync_index, cam_id, frame_index, frame_time,
                                                      object_id, keypoint_id, img_loc_x, img_loc_y

Cameras are called cam0, cam1, ... after their numbers. Older releases have ``port`` and
``point_id``, and one person, without ``object_id``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.io.files import head
from stcalib_ros.io.lens_formats.toml import toml_lenses
from stcalib_ros.io.sources.cameras import plain_name, with_suffix
from stcalib_ros.io.sources.form import (
    CameraPoses,
    Pose,
    PoseFormat,
    PoseSource,
    reading,
    whole_number,
)
from stcalib_ros.io.sources.tables import (
    CAMERA,
    column_names,
    find_column,
    read_table,
    stamps_of,
)
from stcalib_ros.io.toml_files import read_toml

_KEYPOINT = ("keypoint_id", "point_id")
_BOARDS = ("charuco", "aruco", "chessboard", "extrinsic", "intrinsic")
"""Words in the paths of tables that are about boards, not people."""
_BODIES = ("coco_17", "halpe_26", "blazepose_33", "coco_wholebody_133")
"""Layouts of Caliscope's trackers, by the number of keypoints."""
_LEVELS = 4
"""Folders from a table upwards in which lenses and times are looked for, count: those of the
tracker, of the recording, of all recordings and of the project. Definition of the layout."""


def _is_table(text: str) -> bool:
    columns = column_names(text.partition("\n")[0])
    return {"sync_index", "img_loc_x"} <= set(columns) and find_column(
        columns, _KEYPOINT
    ) is not None


def is_caliscope(path: Path, files: Sequence[Path]) -> bool:
    """Whether there is a table of points, as of Caliscope."""
    del path
    return any(_is_table(head(file)) for file in with_suffix(files, ".csv"))


def read_caliscope(path: Path, files: Sequence[Path]) -> PoseSource:
    """Read the poses of all cameras, with lenses and times.

    Raises
    ------
    InputError
        There is no table of people, or several, or one has another form.
    """
    tables = [file for file in with_suffix(files, ".csv") if _is_table(head(file))]
    people = [
        t for t in tables if not any(w in str(t.relative_to(path.parent)).lower() for w in _BOARDS)
    ]
    if not people:
        raise InputError(
            f"{path} has no table of people, xy_TRACKER.csv, but {len(tables)} of boards: track "
            "the people of a recording with Caliscope, and convert again"
        )
    if len(people) > 1:
        raise InputError(
            f"{path} has several tables of people: name one: {', '.join(map(str, people))}"
        )
    (table,) = people
    with reading(table, "a table of Caliscope's points"):
        return PoseSource(path, tuple(_cameras(table)))


def _cameras(file: Path) -> Iterator[CameraPoses]:
    table = read_table(file)
    camera_column, keypoint_column = (find_column(table, n) for n in (CAMERA, _KEYPOINT))
    if camera_column is None or keypoint_column is None:
        raise KeyError("cam_id")
    ids, joints = (np.array(table[c], dtype=np.int64) for c in (camera_column, keypoint_column))
    people = np.array(table.get("object_id", ["0"] * len(ids)), dtype=np.int64)
    xy = np.array([table["img_loc_x"], table["img_loc_y"]], dtype=np.float64).T
    stamps = np.array(_microseconds(table["frame_time"]), dtype=np.int64)
    n_joints = _n_joints(int(joints.max()), file.stem)
    lenses, times = _lenses(file), _times(file)
    for camera in np.unique(ids):
        rows = np.flatnonzero((ids == camera) & (joints < n_joints) & (joints >= 0) & (stamps >= 0))
        taken = np.unique([*stamps[rows], *times.get(int(camera), [])]).astype(np.int64)
        image = np.searchsorted(taken, stamps[rows])
        poses = _poses(image, people[rows], joints[rows], xy[rows], n_joints)
        name = plain_name(str(whole_number(camera)))
        yield CameraPoses(name, np.arange(len(taken)), poses, taken, lens=lenses.get(name))


def _microseconds(values: Sequence[str]) -> list[int]:
    """Times in ns, of whole us: two tables may differ in the last digits of the same time."""
    return [round(stamp, -3) for stamp in stamps_of("frame_time", values)]


def _n_joints(last: int, name: str) -> int:
    """Return the number of keypoints of the body; MediaPipe's hands and faces follow after gaps."""
    if "holistic" in name.lower():
        return LAYOUTS["blazepose_33"].n_joints
    sizes = [LAYOUTS[body].n_joints for body in _BODIES]
    return next((n for n in sizes if last < n), LAYOUTS["blazepose_33"].n_joints)


def _poses(
    image: np.ndarray, people: np.ndarray, joints: np.ndarray, xy: np.ndarray, n_joints: int
) -> tuple[Pose, ...]:
    keys, place = np.unique(np.c_[image, people], axis=0, return_inverse=True)
    points = np.zeros((len(keys), n_joints, 3))
    points[place.ravel(), joints] = np.c_[xy, np.ones(len(xy))]
    return tuple(Pose(int(k), whole_number(i), p) for (k, i), p in zip(keys, points, strict=True))


def _above(file: Path, name: str) -> Path | None:
    folders = file.absolute().parents[:_LEVELS]
    return next((folder / name for folder in folders if (folder / name).is_file()), None)


def _lenses(file: Path) -> dict[str, Intrinsics]:
    array = _above(file, "camera_array.toml")
    return {} if array is None else toml_lenses(read_toml(array), str(array))


def _times(file: Path) -> dict[int, list[int]]:
    """Times of all images by the number of the camera, also of those without points."""
    path = _above(file, "timestamps.csv")
    if path is None:
        return {}
    with reading(path, "a table of Caliscope's times"):
        table = read_table(path)
        column = find_column(table, CAMERA)
        if column is None:
            raise KeyError("cam_id")
        found: dict[int, list[int]] = {}
        for camera, stamp in zip(table[column], _microseconds(table["frame_time"]), strict=True):
            found.setdefault(int(camera), []).append(stamp)
    return found


CALISCOPE = PoseFormat(
    "a Caliscope project or recording: xy_TRACKER.csv, camera_array.toml",
    is_caliscope,
    read_caliscope,
)
