"""Linear interpolation of tracks between their frames."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.arrays import BoolArray, Float64Array, FloatArray, IntArray

_MAX_GAP = 2.6
"""Frame periods. Longer gaps between samples are not bridged: one dropped frame is, with jitter.
Derived: 2 periods and a margin for jitter of 0.45 frames."""


def frame_period(stamps: Float64Array) -> float:
    """Usual time between images, seconds: robust against dropped frames and jitter."""
    return float(np.median(np.diff(stamps))) if len(stamps) > 1 else float("inf")


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

    def __init__(self, stamps: Float64Array, times: Float64Array, *, period: float) -> None:
        after = np.clip(np.searchsorted(stamps, times), 1, max(len(stamps) - 1, 1))
        self.before: IntArray = after - 1
        self.after: IntArray = np.minimum(after, len(stamps) - 1)
        interval = stamps[self.after] - stamps[self.before]
        with np.errstate(divide="ignore", invalid="ignore"):
            self.fraction: Float64Array = (times - stamps[self.before]) / interval
        slack = 1e-6
        self.inside: BoolArray = (
            (interval <= _MAX_GAP * period)
            & (self.fraction >= -slack)
            & (self.fraction <= 1 + slack)
        )
        self.interval: Float64Array = interval

    def __call__(self, values: FloatArray) -> Float64Array:
        """Values (N, ...) at the wanted times; NaN outside and in gaps."""
        u = np.where(self.inside, self.fraction, np.nan).reshape(-1, *[1] * (values.ndim - 1))
        return np.asarray((1 - u) * values[self.before] + u * values[self.after])

    @property
    def variance(self) -> tuple[Float64Array, Float64Array]:
        """Variance (N,) of values over that of a sample, and its time derivative, per second."""
        u = self.fraction
        return np.asarray((1.0 - u) ** 2 + u**2), np.asarray((4.0 * u - 2.0) / self.interval)

    def both(self, values: FloatArray) -> tuple[Float64Array, Float64Array]:
        """Values (N, ...) at the wanted times, and their time derivative, per second."""
        shape = (-1, *[1] * (values.ndim - 1))
        before = values[self.before]
        difference = values[self.after] - before
        difference *= np.where(self.inside, 1.0, np.nan).reshape(shape)
        with np.errstate(divide="ignore", invalid="ignore"):
            per_second = 1.0 / self.interval.reshape(shape)
            return before + self.fraction.reshape(shape) * difference, difference * per_second
