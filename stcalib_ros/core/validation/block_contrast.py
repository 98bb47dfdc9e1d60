"""The stretch of time in which a series differs most from the rest of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray

_CHI_SQUARED_MEDIAN = (0.4549, 1.3863, 2.3660)
"""Ratio to the variance. Medians of the chi-square distributions of one to three degrees of
freedom; tabulated."""

_REGULARISED = 1e-9
"""Ratio to the trace. What keeps the information of few windows from being singular. Numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class Contrast:
    """The stretch of a series that differs most from the rest.

    Attributes
    ----------
    begin, end : int
        Samples ``begin <= k < end`` are the stretch; the rest is before and behind.
    difference : (m,) ndarray
        Mean of the stretch less mean of the rest.
    evidence : float
        Squared difference over its variance if all errors were independent.
    inflation : float
        By how much the series scatters more than that, from one sample to the next: variance over
        what it would be.
    """

    begin: int
    end: int
    difference: Float64Array
    evidence: float
    inflation: float

    @property
    def significance(self) -> float:
        """Squared difference over its variance."""
        return self.evidence / self.inflation

    @property
    def size(self) -> float:
        """Length of the difference."""
        return float(np.linalg.norm(self.difference))


def largest_contrast(
    time: Float64Array,
    x: Float64Array,
    information: Float64Array,
    *,
    least_inflation: float,
    one_border: bool = False,
) -> Contrast:
    """Find the stretch of a series whose mean differs most significantly from that of the rest.

    A step, a drift and a stretch between two steps all show as one; a single sample amid others
    does not, which is an outlier. How much the series scatters is measured by each sample against
    the line through its neighbours, so that neither steps nor drifts count as scatter.

    Parameters
    ----------
    time : (K,) ndarray
        Increasing.
    x : (K, m) ndarray
    information : (K, m, m) ndarray
        Inverse covariances of x, but for a common factor.
    least_inflation : float
        Smallest factor that is taken for the scatter.
    one_border : bool
        Only stretches from the begin or to the end: what changes does so for good.
    """
    K, m = x.shape
    begin, end = np.triu_indices(K + 1, 1)
    part = _long_enough(begin, end, K, one_border=one_border)
    begin, end = begin[part], end[part]
    H, b = (_cumulated(one) for one in (information, _times(information, _without_outliers(x))))
    H = H + _REGULARISED * np.trace(H[-1]) * np.arange(K + 1)[:, None, None] * np.eye(m)
    inside, its = H[end] - H[begin], b[end] - b[begin]
    outside, rest = H[-1] - inside, b[-1] - its
    difference = _solved(inside, its) - _solved(outside, rest)
    variance = np.linalg.inv(inside) + np.linalg.inv(outside)
    evidence = (difference * _solved(variance, difference)).sum(-1)
    best = int(evidence.argmax())
    first, last = int(begin[best]), int(end[best])
    scatter = _scatter(time, x, information, borders=(first, last))
    inflation = max(scatter, least_inflation)
    return Contrast(first, last, difference[best], float(evidence[best]), inflation)


def _without_outliers(x: Float64Array) -> Float64Array:
    """Return samples amid others as the median of three; those at the ends as they are."""
    out: Float64Array = x.copy()
    out[1:-1] = np.median(np.stack([x[:-2], x[1:-1], x[2:]]), axis=0)
    return out


def _long_enough(begin: IntArray, end: IntArray, K: int, *, one_border: bool) -> BoolArray:
    """Whether a stretch is not all, and neither it nor the rest one sample amid others."""
    inside, at_border = end - begin, (begin == 0) | (end == K)
    return np.asarray((inside < K) & (at_border | ((inside > 1) & (not one_border))))


def _scatter(
    time: Float64Array, x: Float64Array, information: Float64Array, *, borders: tuple[int, int]
) -> float:
    """Variance of samples about the lines through their neighbours, over what it should be.

    Samples beside a border of the stretch do not count, unless there are no others.
    """
    variance = np.asarray(np.linalg.inv(information), dtype=np.float64)
    along = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None]
    off = x[1:-1] - (1.0 - along) * x[:-2] - along * x[2:]
    weight = along[..., None]
    own = variance[1:-1] + (1.0 - weight) ** 2 * variance[:-2] + weight**2 * variance[2:]
    squared = (off * _solved(own, off)).sum(-1)
    number = np.arange(1, len(x) - 1)
    apart = np.all([(number < at - 1) | (number > at) for at in borders], axis=0)
    return (
        float(np.median(squared[apart] if apart.any() else squared))
        / (_CHI_SQUARED_MEDIAN[x.shape[1] - 1])
    )


def _times(A: Float64Array, x: Float64Array) -> Float64Array:
    return np.asarray((A @ x[..., None])[..., 0])


def _solved(A: Float64Array, b: Float64Array) -> Float64Array:
    return np.asarray(np.linalg.solve(A, b[..., None])[..., 0])


def _cumulated(values: Float64Array) -> Float64Array:
    """Sums (K + 1, ...) of the values before each sample."""
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
