"""Cameras that take their images at even times, and stamps that are not."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.geometry.interpolation import frame_period
from stcalib_ros.core.model.arrays import Float64Array, IntArray

_SPAN_S = 15.0
_MIN_IMAGES = 30
_OFF = 0.1
_FINE = 0.1
_PHASES = 8
_PASSES = 10
_UNEVEN = 0.4
"""Of a period: deviation of stamps that tell no even times."""


def regular_times(stamps: Float64Array) -> Float64Array:
    """Corrections (N,) that put stamps at even times, images lost in between left out.

    Every quarter of a minute by itself, without changing the mean or the trend of its stamps: a
    rate that wanders slowly does no harm. Zero where the stamps fit no even times.

    Parameters
    ----------
    stamps : (N,) ndarray
        Increasing, s.
    """
    out = np.zeros(len(stamps))
    n_spans = max(1, round(float(np.ptp(stamps)) / _SPAN_S)) if len(stamps) else 1
    for part in np.array_split(np.arange(len(stamps)), n_spans):
        if len(part) >= _MIN_IMAGES:
            out[part] = _line(stamps[part] - stamps[part[0]])
    return out


def _line(since: Float64Array) -> Float64Array:
    """Corrections of some stamps: from the best of several starts."""
    period = frame_period(since)
    step = _FINE * period / float(since[-1])
    rates = (1.0 + np.arange(-_OFF, _OFF, step)) / period
    power = np.abs(np.exp(2j * np.pi * np.outer(rates, since)).sum(1))
    turns = rates[int(power.argmax())] * since
    fits = [_settled(since, turns - phase) for phase in np.arange(_PHASES) / _PHASES]
    best = min(fits, key=lambda correction: float(correction @ correction))
    return best if best.std() < _UNEVEN * period else np.zeros_like(since)


def _settled(since: Float64Array, turns: Float64Array) -> Float64Array:
    """Corrections to even times, from a guess of the number of periods."""
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
