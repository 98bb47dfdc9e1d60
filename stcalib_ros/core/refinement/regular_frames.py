"""Timestamps of cameras that take their images at regular times, and timestamps that jitter."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.geometry.interpolation import frame_period
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.refinement.limits import MAX_IRREGULARITY, MIN_REGULAR_IMAGES

_SPAN_S = 15.0
"""Seconds of timestamps that are fitted by one line. Chosen: clocks of cameras wander less within
that than timestamps jitter."""

_RATE_RANGE = 0.1
"""Fraction. Rates are searched up to so far from that of the median interval. Chosen."""

_RATE_STEP = 0.1
"""Periods over the whole span from one rate to the next. Numerical: a tenth of a cycle."""

_PHASES = 8
"""Count. Phases of the period that the search starts from; more find no better one. Numerical."""

_PASSES = 10
"""Count. Fits of a line, each with the images numbered anew, at most. Numerical."""


def regular_times(stamps: Float64Array) -> Float64Array:
    """Corrections (N,) that move timestamps to regular times, lost images left out.

    Every quarter of a minute by itself, without changing the mean or the trend of its timestamps: a
    rate that wanders slowly does no harm. Zero where the timestamps have no regular period.

    Parameters
    ----------
    stamps : (N,) ndarray
        Increasing, s.
    """
    out = np.zeros(len(stamps))
    n_spans = max(1, round(float(np.ptp(stamps)) / _SPAN_S)) if len(stamps) else 1
    for part in np.array_split(np.arange(len(stamps)), n_spans):
        if len(part) >= MIN_REGULAR_IMAGES:
            out[part] = _line(stamps[part] - stamps[part[0]])
    return out


def _line(since: Float64Array) -> Float64Array:
    """Corrections of some timestamps: from the best of several starts."""
    period = frame_period(since)
    turns = _strongest_rate(since, period) * since
    fits = [_converged(since, turns - phase) for phase in np.arange(_PHASES) / _PHASES]
    best = min(fits, key=lambda correction: float(correction @ correction))
    return best if best.std() < MAX_IRREGULARITY * period else np.zeros_like(since)


def _strongest_rate(since: Float64Array, period: float) -> float:
    """Rate, 1/s, at which the phases of times (N,) agree best.

    The rates are those of a regular grid, whose phases are products of a coarse and a fine one:
    one matrix product, of matrices that grow with N to the power of 3/2.
    """
    step = _RATE_STEP * period / float(since[-1])
    rates = (1.0 + np.arange(-_RATE_RANGE, _RATE_RANGE, step)) / period
    n = int(np.ceil(np.sqrt(len(rates))))
    fine = np.exp(2j * np.pi * np.outer(step / period * np.arange(n), since))
    coarse = np.exp(2j * np.pi * np.outer(since, rates[::n]))
    power = np.abs(fine @ coarse).T.ravel()[: len(rates)]
    return float(rates[power.argmax()])


def _converged(since: Float64Array, turns: Float64Array) -> Float64Array:
    """Corrections to regular times, from a guess of the number of periods."""
    number = _numbers(turns)
    line = since
    for _ in range(_PASSES):
        slope, start = np.polyfit(number, since, 1)
        line = slope * number + start
        again = _numbers((since - start) / slope)
        if np.array_equal(again, number):
            break
        number = again
    return np.asarray(line - since)


def _numbers(turns: Float64Array) -> IntArray:
    """Whole numbers nearest to increasing ones that grow by one at least from image to image.

    What they are ahead of the count of the images must not fall: an isotonic regression, whose
    rounded solution is the best one in whole numbers.
    """
    nearest: IntArray = np.rint(turns).astype(np.int64)
    if (np.diff(nearest) > 0).all():
        return nearest
    count = np.arange(len(turns))
    return np.asarray(count + np.rint(_isotonic(turns - count)), dtype=np.int64)


def _isotonic(values: Float64Array) -> Float64Array:
    """The nearest values that do not fall (least squares): neighbours that do are pooled."""
    means: list[float] = []
    sizes: list[int] = []
    for value in values.tolist():
        mean, size = float(value), 1
        while means and means[-1] > mean:
            n = sizes.pop()
            mean = (means.pop() * n + mean * size) / (n + size)
            size += n
        means.append(mean)
        sizes.append(size)
    return np.repeat(means, sizes)
