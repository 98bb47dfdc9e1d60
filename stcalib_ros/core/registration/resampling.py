"""Tracks resampled to uniform times: the form in which two cameras are compared."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.geometry.interpolation import Interpolation, frame_period
from stcalib_ros.core.model.arrays import BoolArray, Float32Array, Float64Array
from stcalib_ros.core.model.keypoint_layouts import TRUNK_JOINTS
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.registration.limits import MAX_SAMPLES_PER_IMAGE, MIN_BONE_M


@dataclass(frozen=True, slots=True)
class Grid:
    """Uniform sample times ``start_s + k step_s``, k < n, by the clock of every camera.

    Attributes
    ----------
    start_s, step_s : float
        Time of the first sample and between samples, seconds.
    n : int
        Number of samples.
    """

    start_s: float
    step_s: float
    n: int


def common_grid(cameras: Sequence[LiftedCamera], step_s: float | None = None) -> Grid:
    """Return the grid that spans all frames of some cameras, at a step or at their common one.

    The step is longer where there would be many more samples than images: whatever the stamps are,
    time and memory grow with the number of images.
    """
    start_s = min(float(camera.stamps[0]) for camera in cameras)
    end_s = max(float(camera.stamps[-1]) for camera in cameras)
    if step_s is None:
        most = max(len(camera.stamps) for camera in cameras)
        step_s = max(common_step(cameras), (end_s - start_s) / (MAX_SAMPLES_PER_IMAGE * most))
    return Grid(start_s, step_s, int((end_s - start_s) / step_s) + 1)


@dataclass(frozen=True, slots=True, eq=False)
class GridTracks:
    """Oriented points and positions of one camera's tracks on the grid of `step` seconds.

    Attributes
    ----------
    name : str
    start : float
        Time of sample 0, by the clock of the camera.
    step : float
        Seconds between samples.
    oriented : (P, N, D, 3) ndarray
        Bone direction v in the optical frame, as long as its weight; 0 where unknown.
    position : (P, N, 3) ndarray
        Middle of the body in the optical frame, metres; NaN where unknown.
    """

    name: str
    start: float
    step: float
    oriented: Float32Array
    position: Float64Array

    @property
    def weight(self) -> Float32Array:
        """Weights (P, N, D): square root of the bone's length; 0 where unknown."""
        v = self.oriented
        return np.asarray(np.sqrt(v[..., 0] ** 2 + v[..., 1] ** 2 + v[..., 2] ** 2))

    @property
    def present(self) -> BoolArray:
        """Samples (P, N) at which a track is observed."""
        observed: BoolArray = np.isfinite(self.position[..., 0])
        return observed


def sample_camera(
    camera: LiftedCamera, skeleton: Skeleton, *, start: float, step: float, n: int
) -> GridTracks:
    """Resample the tracks of a camera at ``start + step * k`` by linear interpolation."""
    period = frame_period(camera.stamps)
    times: Float64Array = start + step * np.arange(n, dtype=np.float64)
    paths = (
        Interpolation(camera.stamps[track.frames], times, period=period)(track.joints_cam)
        for track in camera.tracks
    )
    return tracks_on_grid(camera.name, paths, skeleton, start=start, step=step, n=n)


def tracks_on_grid(
    name: str,
    paths: Iterable[Float64Array],
    skeleton: Skeleton,
    *,
    start: float,
    step: float,
    n: int,
) -> GridTracks:
    """Return tracks from their joints (n, J, 3) on the grid; NaN where they are unknown."""
    D = len(skeleton.directions)
    tracks = [_oriented(path, skeleton) for path in paths]
    oriented = np.zeros((len(tracks), n, D, 3), np.float32)
    position = np.full((len(tracks), n, 3), np.nan)
    for p, columns in enumerate(tracks):
        oriented[p], position[p] = columns
    return GridTracks(name, start, step, oriented, position)


def _oriented(joints: Float64Array, skeleton: Skeleton) -> tuple[Float64Array, Float64Array]:
    """Weighted directions (N, D, 3) and positions (N, 3) of one track."""
    bones = np.einsum("dj,njk->ndk", skeleton.directions, np.nan_to_num(joints))
    missing = np.einsum("dj,nj->nd", skeleton.directions != 0, np.isnan(joints[..., 0]))
    length = np.linalg.norm(bones, axis=-1)
    known = (missing == 0) & (length > MIN_BONE_M)
    typical = np.sqrt([np.median(length[k, d]) if k.any() else 0.0 for d, k in enumerate(known.T)])
    factor = known * typical / np.maximum(length, 1e-6)
    return bones * factor[..., None], joints_centre(joints, skeleton)


def joints_centre(joints: Float64Array, skeleton: Skeleton) -> Float64Array:
    """Return the middle of the body (..., 3): mean of hips and shoulders, or of all joints."""
    names = skeleton.layout.joint_names
    trunk = [names.index(n) for n in TRUNK_JOINTS if n in names] or list(range(len(names)))
    return np.asarray(joints[..., trunk, :].mean(-2))


def common_step(cameras: Sequence[LiftedCamera]) -> float:
    """Return the step of the grid, seconds: the upper median of the frame periods.

    A finer one would leave most of its samples to one fast camera alone.
    """
    periods = sorted(frame_period(camera.stamps) for camera in cameras)
    return periods[len(periods) // 2]
