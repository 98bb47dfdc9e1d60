"""Oriented points of two cameras over windows of T frames (Section III-A, III-B).

The sequence is subsampled at certain frames, and in each window of T frames from there every
person is tracked. A window has its own persons; rotation and offset are common to all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.geometry.interpolation import Interpolation, frame_period
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.registration.resampling import sample_camera


@dataclass(frozen=True, slots=True, eq=False)
class OrientedPoints:
    """Oriented points of one camera's tracks at uniform times.

    Attributes
    ----------
    v : (P, N, S, 3) ndarray
        Unit direction from the parent joint to the joint, of every bone; 0 where unknown.
    known : (P, N, S) ndarray
        1 where the direction is known, else 0.
    x : (P, N, J, 2) ndarray
        Joints on the plane z = 1; NaN where unknown.
    focal : (P, N, J) ndarray
        Pixels per unit of `x`.
    body : (P, N, 3) ndarray
        Mean joint in the optical frame by the monocular pose, metres; NaN where unknown.
    start, step : float
        Time of sample 0 by the clock of the camera, and between samples, seconds.
    """

    v: Float64Array
    known: Float64Array
    x: Float64Array
    focal: Float64Array
    body: Float64Array
    start: float
    step: float


def oriented_points(
    camera: LiftedCamera, skeleton: Skeleton, *, start: float, step: float, n: int
) -> OrientedPoints:
    """Compute oriented points at ``start + step * k``: the directions of the bones alone."""
    grid = sample_camera(camera, skeleton, start=start, step=step, n=n)
    bones = sum(parent >= 0 for parent in skeleton.layout.parents)
    weight = grid.weight[:, :, :bones].astype(np.float64)
    known: Float64Array = np.where(weight > 0, 1.0, 0.0)
    v = grid.oriented[:, :, :bones] / np.where(weight > 0, weight, 1.0)[..., None]
    times: Float64Array = start + step * np.arange(n, dtype=np.float64)
    P, J = len(camera.tracks), skeleton.layout.n_joints
    x, focal = np.full((P, n, J, 2), np.nan), np.full((P, n, J), np.nan)
    period = frame_period(camera.stamps)
    for p, track in enumerate(camera.tracks):
        at = Interpolation(camera.stamps[track.frames], times, period=period)
        x[p], focal[p] = at(track.x), at(track.focal)
    return OrientedPoints(v, known, x, focal, grid.position, start, step)


def spread_windows(n: int, window: int, n_windows: int) -> IntArray:
    """Return the first samples of at most `n_windows` disjoint windows, uniform over n samples."""
    fitting = max(1, min(n_windows, n // window))
    return np.rint(np.linspace(0, max(n - window, 0), fitting)).astype(np.int64)


def samples_of(starts: Sequence[int] | IntArray, window: int, lag: IntArray) -> IntArray:
    """Return the samples (..., W, T) of windows at lags (...)."""
    inside = np.asarray(starts)[:, None] + np.arange(window)
    return np.asarray(np.asarray(lag)[..., None, None] + inside, dtype=np.int64)


def take(values: Float64Array, samples: IntArray) -> Float64Array:
    """Return the entries (P, ..., W, T, ...) of (P, N, ...) at samples; zero outside of 0..N-1."""
    n = values.shape[1]
    inside = (samples >= 0) & (samples < n)
    found = values[:, np.clip(samples, 0, n - 1)]
    mask = inside.reshape(1, *inside.shape, *[1] * (values.ndim - 2))
    return np.where(mask, found, 0.0)
