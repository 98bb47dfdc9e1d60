"""Linear interpolation of tracks between their frames."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.arrays import BoolArray, Float64Array, FloatArray, IntArray

_MAX_GAP = 2.6
"""Frame periods. Longer gaps between samples are not bridged: one dropped frame is, with jitter.
Derived: 2 periods and a margin for jitter of 0.45 frames."""


LONGEST_BRIDGE_S = 0.2
"""Seconds. Joints that are missing for less than that between two images are read off between them
where tracks are compared: half a swing of an arm takes longer. Chosen; the adjustment uses what was
observed only."""


_SPAN_IMAGES = 24
"""Count. The mean period is known from spans of so many images. Derived: one bunch more or less of
three images is an eighth of the span, and half of all spans may have a gap in them."""

_LEAST_USUAL = 0.5
"""Ratio to the mean period. A median interval that is less is one within bunches. Derived: where
images are lost at random, the mean period is twice the median interval at most."""


_LOST_IMAGE = 1.6
"""Frame periods. In longer intervals an image was lost. Derived: between one and two, further from
one for jitter."""


def mean_period(stamps: Float64Array) -> float:
    """Time between images over spans of many, seconds: robust against bunches and long gaps."""
    if len(stamps) < 2:
        return float("inf")
    n = max(1, min(_SPAN_IMAGES, (len(stamps) - 1) // 4))
    return float(np.median(stamps[n:] - stamps[:-n])) / n


def frame_period(stamps: Float64Array) -> float:
    """Usual time between images, seconds: robust against dropped frames, jitter and bunches."""
    if len(stamps) < 2:
        return float("inf")
    usual, mean = float(np.median(np.diff(stamps))), mean_period(stamps)
    return usual if usual >= _LEAST_USUAL * mean else mean


def frame_rate(stamps: Float64Array) -> float:
    """Images per second where none is missing; 0 of fewer than two.

    Of a camera of 15 Hz two thirds of whose images are used, the intervals are long and short in
    turn: that is 10 Hz, while the usual interval is that of 7.5.
    """
    period = frame_period(stamps)
    intervals = np.diff(stamps)
    whole = intervals[intervals < _LOST_IMAGE * period]
    mean = float(whole.mean()) if len(whole) else 0.0
    return 1.0 / (mean if mean >= _LEAST_USUAL * period else period)


def bridged(values: FloatArray, stamps: Float64Array, *, longest_s: float) -> FloatArray:
    """Fill what is missing between two samples that are near in time, linearly.

    Parameters
    ----------
    values : (F, J, k) ndarray
        NaN where missing, all k at once.
    stamps : (F,) ndarray
        Increasing times of the samples, seconds.
    longest_s : float
        Longest time between two samples that is bridged.
    """
    missing = np.isnan(values[..., 0])
    if not missing.any():
        return values
    rows = np.arange(len(values))[:, None]
    before = np.maximum.accumulate(np.where(missing, -1, rows), axis=0)
    after = np.minimum.accumulate(np.where(missing, len(values), rows)[::-1], axis=0)[::-1]
    f, j = np.nonzero(missing & (before >= 0) & (after < len(values)))
    here, there = before[f, j], after[f, j]
    gap = stamps[there] - stamps[here]
    near = gap <= longest_s
    f, j, here, there = f[near], j[near], here[near], there[near]
    u = ((stamps[f] - stamps[here]) / gap[near])[:, None]
    filled: FloatArray = values.copy()
    filled[f, j] = (1.0 - u) * values[here, j] + u * values[there, j]
    return filled


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
