"""Residuals that are usual between two cameras, by what the watch itself has seen.

A reported residual is that of other data, and may be wrong; a camera that has moved enlarges all
of its residuals. What the best change of a camera leaves is neither: it is about the same before
and after the camera has moved.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from stcalib_ros.core.geometry.robust import MIN_NOISE_PX
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.monitoring.limits import (
    FIRST_NOISE_PX,
    MAX_NOISE_PX,
    NOISE_SPANS,
)


@dataclass(frozen=True, slots=True)
class Noise:
    """Epipolar distances of every two cameras that their best changes leave, span by span.

    Attributes
    ----------
    recent_px : mapping of (str, str) to tuple of float
        Robust standard deviations of the last spans in which both observed somebody, the newest
        last; the names of the two cameras in alphabetical order.
    """

    recent_px: Mapping[tuple[str, str], tuple[float, ...]] = field(default_factory=dict)

    def px(self, names: Sequence[str]) -> Float64Array:
        """Return the usual epipolar distance (C, C) of every two cameras, standard deviation, px.

        The median of the recent spans, but never less than what good detectors have; two cameras
        that have not observed anybody together have that of all others.
        """
        first = (FIRST_NOISE_PX,)
        known = {pair: float(np.median(first + px)) for pair, px in self.recent_px.items()}
        others = float(np.median(list(known.values()))) if known else FIRST_NOISE_PX
        usual = np.array([[known.get(_pair(a, b), others) for b in names] for a in names])
        return np.asarray(np.maximum(usual, MIN_NOISE_PX))

    def after(self, names: Sequence[str], span_px: Float64Array) -> Noise:
        """Return the noise with one more span.

        Parameters
        ----------
        names : sequence of str
            The C cameras.
        span_px : (C, C) ndarray
            What the best changes leave; NaN where nobody was observed. What is above
            `limits.MAX_NOISE_PX` is no noise: no change explains it.
        """
        recent = dict(self.recent_px)
        for i, j in np.argwhere(np.triu(span_px <= MAX_NOISE_PX, 1)):
            pair = _pair(names[i], names[j])
            recent[pair] = (*recent.get(pair, ()), float(span_px[i, j]))[-NOISE_SPANS:]
        return Noise(recent)


def _pair(a: str, b: str) -> tuple[str, str]:
    return (a, b) if a < b else (b, a)
