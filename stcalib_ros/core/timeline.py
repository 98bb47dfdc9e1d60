"""Tracks sampled on one uniform grid of times: the form in which two cameras are compared."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.lift import LiftedCamera
from stcalib_ros.core.skeleton import Skeleton
from stcalib_ros.core.types import BoolArray, FloatArray, IntArray, SingleArray

_MAX_GAP = 2.6
"""Samples further apart than this many periods are not bridged."""


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
    oriented: SingleArray
    position: FloatArray

    @property
    def weight(self) -> SingleArray:
        """Weights (P, N, D): square root of the bone's length; 0 where unknown."""
        o = self.oriented
        return np.asarray(np.sqrt(o[..., 0] ** 2 + o[..., 1] ** 2 + o[..., 2] ** 2))

    @property
    def present(self) -> BoolArray:
        """Where a track was seen, (P, N)."""
        seen: BoolArray = np.isfinite(self.position[..., 0])
        return seen


def frame_period(stamps: FloatArray) -> float:
    """Usual time between images, seconds: robust against dropped frames and jitter."""
    return float(np.median(np.diff(stamps))) if len(stamps) > 1 else float("inf")


def sample_camera(
    camera: LiftedCamera, skeleton: Skeleton, *, start: float, step: float, n: int
) -> GridTracks:
    """Sample the tracks of a camera at ``start + step * k`` by linear interpolation."""
    period = frame_period(camera.stamps)
    times: FloatArray = start + step * np.arange(n, dtype=np.float64)
    paths = (
        Interpolation(camera.stamps[track.frames], times, period=period)(track.joints_cam)
        for track in camera.tracks
    )
    return tracks_on_grid(camera.name, paths, skeleton, start=start, step=step, n=n)


def tracks_on_grid(
    name: str,
    paths: Iterable[FloatArray],
    skeleton: Skeleton,
    *,
    start: float,
    step: float,
    n: int,
) -> GridTracks:
    """Tracks whose joints (n, J, 3) are known on the grid; NaN where they are not."""
    D = len(skeleton.directions)
    tracks = [_oriented(path, skeleton) for path in paths]
    oriented = np.zeros((len(tracks), n, D, 3), np.float32)
    position = np.full((len(tracks), n, 3), np.nan)
    for p, columns in enumerate(tracks):
        oriented[p], position[p] = columns
    return GridTracks(name, start, step, oriented, position)


def _oriented(joints: FloatArray, skeleton: Skeleton) -> tuple[FloatArray, FloatArray]:
    """Weighted directions (N, D, 3) and positions (N, 3) of one track."""
    bones = np.einsum("dj,njk->ndk", skeleton.directions, np.nan_to_num(joints))
    missing = np.einsum("dj,nj->nd", skeleton.directions != 0, np.isnan(joints[..., 0]))
    length = np.linalg.norm(bones, axis=-1)
    known = (missing == 0) & (length > 1e-6)
    typical = np.sqrt([np.median(length[k, d]) if k.any() else 0.0 for d, k in enumerate(known.T)])
    share = known * typical / np.maximum(length, 1e-6)
    return bones * share[..., None], joints_centre(joints, skeleton)


def joints_centre(joints: FloatArray, skeleton: Skeleton) -> FloatArray:
    """Middle of the body (..., 3): mean of hips and shoulders, of all joints in other layouts."""
    names = skeleton.layout.joint_names
    trunk = [names.index(n) for n in _TRUNK if n in names] or list(range(len(names)))
    return np.asarray(joints[..., trunk, :].mean(-2))


_TRUNK = ("left_hip", "right_hip", "left_shoulder", "right_shoulder")


class Interpolation:
    """Linear interpolation of samples at irregular times, without bridging gaps.

    Parameters
    ----------
    stamps : (F,) ndarray
        Increasing times of the samples.
    times : (N,) ndarray
        Where values are wanted.
    period : float
        Usual interval between samples, seconds; one lost sample is bridged.
    """

    def __init__(self, stamps: FloatArray, times: FloatArray, *, period: float) -> None:
        after = np.clip(np.searchsorted(stamps, times), 1, max(len(stamps) - 1, 1))
        self.before: IntArray = after - 1
        self.after: IntArray = np.minimum(after, len(stamps) - 1)
        interval = stamps[self.after] - stamps[self.before]
        with np.errstate(divide="ignore", invalid="ignore"):
            self.fraction: FloatArray = (times - stamps[self.before]) / interval
        slack = 1e-6
        self.inside: BoolArray = (
            (interval <= _MAX_GAP * period)
            & (self.fraction >= -slack)
            & (self.fraction <= 1 + slack)
        )
        self.interval: FloatArray = interval

    def __call__(self, values: FloatArray) -> FloatArray:
        """Values (N, ...) at the wanted times; NaN outside and in gaps."""
        u = np.where(self.inside, self.fraction, np.nan).reshape(-1, *[1] * (values.ndim - 1))
        return np.asarray((1 - u) * values[self.before] + u * values[self.after])

    @property
    def variance(self) -> tuple[FloatArray, FloatArray]:
        """Variance (N,) of values over that of a sample, and its time derivative, per second."""
        u = self.fraction
        return np.asarray((1.0 - u) ** 2 + u**2), np.asarray((4.0 * u - 2.0) / self.interval)

    def both(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values (N, ...) at the wanted times, and their time derivative, per second."""
        shape = (-1, *[1] * (values.ndim - 1))
        before = values[self.before]
        difference = values[self.after] - before
        difference *= np.where(self.inside, 1.0, np.nan).reshape(shape)
        with np.errstate(divide="ignore", invalid="ignore"):
            per_second = 1.0 / self.interval.reshape(shape)
            return before + self.fraction.reshape(shape) * difference, difference * per_second


def common_step(cameras: Sequence[LiftedCamera]) -> float:
    """Step of the grid: the median of the frame periods, the longer of two in the middle.

    A finer one would leave most of its samples to one fast camera alone.
    """
    periods = sorted(frame_period(camera.stamps) for camera in cameras)
    return periods[len(periods) // 2]
