"""Cameras that take their images at even times, and stamps that are not."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.timeline import frame_period
from stcalib_ros.core.types import FloatArray, IntArray

_SPAN_S = 15.0
_MIN_IMAGES = 30
_OFF = 0.1
_FINE = 0.1
_PHASES = 8
_PASSES = 10


def even_times(stamps: FloatArray) -> FloatArray:
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


def _line(since: FloatArray) -> FloatArray:
    """Corrections of some stamps: from the best of several starts."""
    period = frame_period(since)
    step = _FINE * period / float(since[-1])
    rates = (1.0 + np.arange(-_OFF, _OFF, step)) / period
    power = np.abs(np.exp(2j * np.pi * np.outer(rates, since)).sum(1))
    turns = rates[int(power.argmax())] * since
    fits = [_settled(since, turns - phase) for phase in np.arange(_PHASES) / _PHASES]
    number, line = min(fits, key=lambda fit: _badness(since, *fit))
    if (np.diff(number) < 1).any():
        return np.zeros_like(since)
    return line - since


def _settled(since: FloatArray, turns: FloatArray) -> tuple[IntArray, FloatArray]:
    """Numbers of the images, and the even times, from a guess of the number of periods."""
    number: IntArray = np.rint(turns).astype(np.int64)
    line = since
    for _ in range(_PASSES):
        slope, start = np.polyfit(number, since, 1)
        line = slope * number + start
        again: IntArray = np.rint((since - start) / slope).astype(np.int64)
        if np.array_equal(again, number):
            break
        number = again
    return number, line


def _badness(since: FloatArray, number: IntArray, line: FloatArray) -> tuple[int, float]:
    """Images that share a number, then how far the stamps are from even ones."""
    return int((np.diff(number) < 1).sum()), float(((line - since) ** 2).sum())
