"""Common form of all data sets: cameras, and the people with known joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.visibility import project_visible
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.io.lens_model import opencv_intrinsics
from stcalib_ros.io.limits import MAX_TABLE
from stcalib_ros.io.plausible import require_lens, require_position, require_rotation

_MIN_JOINTS = 6
"""Joints in the image, count, from which on a person counts as detected. Chosen."""


@dataclass(frozen=True, slots=True)
class DatasetOptions:
    """Part of a data set to be read, and source of its poses.

    Attributes
    ----------
    cameras : tuple of str
        Names or numbers in the data set, in the order of the result; none: all.
    first, last : int
        Frames by the numbering of the data set, both included; `last` below 0: to the end.
    poses : Path or None
        Folder with the poses of a detector, and of a lifter where there is one (see
        `alphapose.pose_detections`).
    sigma_px : float
        Noise added to the true joints without `poses`, px per axis.
    seed : int
        Seed of that noise.
    """

    cameras: tuple[str, ...] = ()
    first: int = 0
    last: int = -1
    poses: Path | None = None
    sigma_px: float = 3.0
    seed: int = 0

    def has(self, frame: int) -> bool:
        """Whether a frame is to be read."""
        return frame >= self.first and (self.last < 0 or frame <= self.last)


@dataclass(frozen=True, slots=True, eq=False)
class Dataset:
    """A scene as a data set describes it.

    Attributes
    ----------
    path : Path
    names : tuple of str
        Cameras.
    image_size : (C, 2) ndarray of int
    K : (C, 3, 3) ndarray
    dist : (C, 5) ndarray
    R, t : (C, 3, 3), (C, 3) ndarray
        ``x_cam = R x_world + t``, metres.
    fps : float
        NaN where the data set does not say.
    frame_number : (F,) ndarray of int
        Increasing.
    joint_names : tuple of str
        Of `joints_world`; none: there are no 3D poses.
    joints_world : (F, P, J, 3) ndarray
        True joints, metres; NaN where unknown.
    boxes : (N, 7) ndarray
        Index of the frame, index of the camera, person, left, top, right, bottom (px).
    """

    path: Path
    names: tuple[str, ...]
    image_size: IntArray
    K: Float64Array
    dist: Float64Array
    R: Float64Array
    t: Float64Array
    fps: float
    frame_number: IntArray
    joint_names: tuple[str, ...]
    joints_world: Float64Array
    boxes: Float64Array

    def lens(self, c: int) -> Intrinsics:
        """Lens of camera c."""
        width, height = (int(n) for n in self.image_size[c])
        return opencv_intrinsics((width, height), self.K[c], self.dist[c])

    def require_cameras(self) -> None:
        """Demand cameras through which points can be projected.

        Raises
        ------
        InputError
            A number of one is none of a camera; the message names it.
        """
        for c, name in enumerate(self.names):
            require_lens(self.lens(c), f"{self.path}: camera {name}")
            require_rotation(self.R[c], f"{self.path}: R of camera {name}")
            require_position(self.t[c], f"{self.path}: t of camera {name}")

    def in_camera(self, c: int) -> Float64Array:
        """True joints (F, P, J, 3) in the frame of camera c."""
        return np.asarray(self.joints_world @ self.R[c].T + self.t[c])


@dataclass(frozen=True, slots=True, eq=False)
class Detections:
    """Detected poses.

    Attributes
    ----------
    frame, camera, track, person : (N,) ndarray of int
        Indices; tracks are of one camera; person -1: unknown.
    kp2d : (N, J, 3) ndarray
        x, y in px and score; 0, 0, 0 where not detected.
    kp3d : (N, J, 3) ndarray or None
        Monocular pose in the axes of the camera; None: there are none.
    joint_names : tuple of str
    metric : bool
        `kp3d` is in metres.
    """

    frame: IntArray
    camera: IntArray
    track: IntArray
    person: IntArray
    kp2d: Float64Array
    kp3d: Float64Array | None
    joint_names: tuple[str, ...]
    metric: bool


def noisy_detections(dataset: Dataset, sigma_px: float, rng: np.random.Generator) -> Detections:
    """True joints in each camera with Gaussian noise of `sigma_px` per axis in the image.

    The paper's "Robustness to Noise": keypoints and 3D poses are of the same noisy points, and
    every person is one track.
    """
    parts = [_noisy_camera(dataset, c, sigma_px, rng) for c in range(len(dataset.names))]
    frame, camera, person, kp2d, kp3d = (np.concatenate(p) for p in zip(*parts, strict=True))
    names = dataset.joint_names
    return Detections(frame, camera, person, person, kp2d, kp3d, names, metric=True)


def _noisy_camera(
    dataset: Dataset, c: int, sigma_px: float, rng: np.random.Generator
) -> tuple[IntArray, IntArray, IntArray, Float64Array, Float64Array]:
    lens, points = dataset.lens(c), dataset.in_camera(c)
    metres = sigma_px * np.abs(points[..., 2:]) / np.sqrt(lens.K[0, 0] * lens.K[1, 1])
    points = points + metres * rng.standard_normal(points.shape)
    pixels = project_visible(points, lens)
    observed: BoolArray = np.asarray(np.isfinite(pixels).all(-1))
    scored = np.concatenate([np.nan_to_num(pixels), np.ones_like(pixels[..., :1])], -1)
    frame, person = np.nonzero(observed.sum(-1) >= _MIN_JOINTS)
    kp2d = np.where(observed[frame, person][:, :, None], scored[frame, person], 0.0)
    return frame, np.full_like(frame, c), person, kp2d, points[frame, person]


def arrays_of(dataset: Dataset, detections: Detections) -> dict[str, NDArray[Any]]:
    """Return the arrays of a multi-view file."""
    names = np.array(detections.joint_names)
    lifted = {} if detections.kp3d is None else {"det_kp3d": detections.kp3d, "kp3d_names": names}
    return {
        "camera_names": np.array(dataset.names),
        "image_size": dataset.image_size,
        "K": dataset.K,
        "dist": dataset.dist,
        "R": dataset.R,
        "t": dataset.t,
        "fps": np.array(dataset.fps),
        "frame_number": dataset.frame_number,
        "det_frame": detections.frame,
        "det_camera": detections.camera,
        "det_track": detections.track,
        "det_person": detections.person,
        "det_kp2d": detections.kp2d,
        "kp_names": names,
        "metric": np.array(detections.metric),
        **lifted,
    }


def chosen(path: Path, names: Sequence[str], wanted: Sequence[str]) -> list[int]:
    """Return the positions of the wanted cameras; all if none is named.

    A camera can also be named by the number at the end of its name: 12 for ``00_12``.

    Raises
    ------
    InputError
        There is no such camera.
    """
    if not wanted:
        return list(range(len(names)))
    by_number = {
        str(int(n.rpartition("_")[2])): n for n in names if n.rpartition("_")[2].isdecimal()
    }
    found = [
        w if w in names else by_number.get(str(int(w)) if w.isdecimal() else w) for w in wanted
    ]
    if missing := [w for w, f in zip(wanted, found, strict=True) if f is None]:
        raise InputError(f"{path} has no camera {', '.join(missing)}: there are {', '.join(names)}")
    return [names.index(str(f)) for f in found]


def numbered(folder: Path, pattern: str, options: DatasetOptions) -> dict[int, Path]:
    """Return the files to be read, by the frame number at the end of their name.

    Raises
    ------
    InputError
        There are none.
    """
    files: dict[int, Path] = {}
    for path in sorted(folder.glob(pattern)):
        digits = path.stem.rpartition("_")[2] if "_" in path.stem else path.stem
        digits = digits.removeprefix("body3DScene")
        if digits.isdecimal() and options.has(int(digits)):
            files[int(digits)] = path
    if not files:
        raise InputError(f"no {pattern} with a wanted frame number in {folder}")
    return files


def stacked_people(frames: Sequence[dict[int, Float64Array]], n_joints: int) -> Float64Array:
    """Stack the joints (F, P, J, 3) of people by id in each frame; P are all ids, in order."""
    ids = sorted({i for people in frames for i in people})
    if len(ids) * len(frames) > MAX_TABLE:
        raise InputError(
            f"{len(ids)} people in {len(frames)} frames are too many: choose frames with --frames"
        )
    out = np.full((len(frames), len(ids), n_joints, 3), np.nan)
    for f, people in enumerate(frames):
        for i, joints in people.items():
            out[f, ids.index(i)] = joints
    return out
