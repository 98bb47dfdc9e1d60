"""A recording of FreeMoCap.

::

    RECORDING/output_data/raw_data/mediapipe_2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy
    RECORDING/synchronized_videos/*.mp4         names, frame rate and size, in the same order
    RECORDING/*camera_calibration*.toml         lenses, in the same order

The array is (C, F, K, 2 or more), px, with MediaPipe's 33 landmarks of the body first; NaN where
nobody is. FreeMoCap follows one person.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.io.lens_formats.toml import toml_lenses
from stcalib_ros.io.npz_files import read_npy
from stcalib_ros.io.sources.cameras import natural_order, plain_name, with_suffix
from stcalib_ros.io.sources.form import CameraPoses, Pose, PoseFormat, PoseSource
from stcalib_ros.io.sources.videos import VIDEO_ENDINGS, with_videos
from stcalib_ros.io.toml_files import read_toml

_ARRAY = "2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy"
_VIDEOS = "synchronized_videos"
_LAYOUT = LAYOUTS["blazepose_33"]


def is_freemocap(path: Path, files: Sequence[Path]) -> bool:
    """Whether there is an array of 2D points, as of FreeMoCap."""
    del path
    return any(_is_array(file) for file in files)


def _is_array(file: Path) -> bool:
    return file.name.lower().endswith(_ARRAY.lower())


def read_freemocap(path: Path, files: Sequence[Path]) -> PoseSource:
    """Read the poses of all cameras, with lenses and frame rate.

    Raises
    ------
    InputError
        There is no such array, or it has another shape than the videos and lenses say.
    """
    arrays = [file for file in files if _is_array(file)]
    if len(arrays) != 1:
        raise InputError(f"{path} has {len(arrays)} files of the name ..{_ARRAY}: expected one")
    xy = np.asarray(read_npy(arrays[0]), dtype=np.float64)
    if xy.ndim != 4 or xy.shape[2] < _LAYOUT.n_joints or xy.shape[3] < 2:
        raise InputError(
            f"{arrays[0]} has shape {xy.shape}, expected (C, F, {_LAYOUT.n_joints} or more, 2)"
        )
    videos = [file for file in files if file.parent.name == _VIDEOS]
    names = [plain_name(f.stem) for f in videos if f.suffix.lower() in VIDEO_ENDINGS]
    names = sorted(names, key=natural_order) or [f"cam{c}" for c in range(len(xy))]
    if len(names) != len(xy):
        raise InputError(f"{path} has {len(names)} videos, but points of {len(xy)} cameras")
    lenses = _lenses(with_suffix(files, ".toml"), len(xy))
    cameras = [_camera(name, xy[c], lenses[c]) for c, name in enumerate(names)]
    return PoseSource(path, with_videos(cameras, path / _VIDEOS), _LAYOUT.name)


def _lenses(files: Sequence[Path], n_cameras: int) -> Sequence[Intrinsics | None]:
    for file in files:
        if "calibration" in file.stem:
            tables = [
                t for t in read_toml(file).values() if isinstance(t, Mapping) and "matrix" in t
            ]
            if len(tables) == n_cameras:
                return [toml_lenses({"0": table}, str(file))["0"] for table in tables]
    return [None] * n_cameras


def _camera(name: str, xy: Float64Array, lens: Intrinsics | None) -> CameraPoses:
    body = xy[:, : _LAYOUT.n_joints, :2]
    points = np.concatenate([body, np.ones_like(body[..., :1])], axis=-1)
    frames = np.flatnonzero(np.isfinite(body).all(-1).any(-1))
    poses = tuple(Pose(int(f), 0, points[f]) for f in frames)
    return CameraPoses(name, np.arange(len(xy)), poses, lens=lens)


FREEMOCAP = PoseFormat(
    "a recording of FreeMoCap: output_data/, synchronized_videos/", is_freemocap, read_freemocap
)
