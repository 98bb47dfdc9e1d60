"""Lenses that are not known, by what all pairs of cameras agree on.

The matrix that explains two tracks is a fundamental one: persons and lags are found without the
focal lengths. That it is an essential one for the right lenses is one or two constraints per pair,
which are solved together: the relative poses of all pairs and the lenses of all cameras minimize
the robust Sampson distances and the priors of the lenses.

Pairs do not determine everything. Where all optical axes meet in one point, a sphere about it is
seen in every image as a circle about the principal point, as the absolute conic is, and one factor
of all focal lengths is free; of two cameras, most is. What is determined is in the covariance; the
adjustment, which sees points in three and more cameras at once, determines the rest.

References
----------
P. Sturm, "On focal length calibration from two views", 2001, and "Critical motion sequences for
the self-calibration of cameras and stereo systems with variable focal length", 2002.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.geometry.robust import NOISE_MARGIN
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.registration.limits import (
    FOCAL_BOUNDS,
    RADIAL_BOUNDS,
)
from stcalib_ros.core.registration.two_view_lenses import (
    OF_PAIR,
    PairPoints,
    TwoViews,
    distances_px,
    first_views,
    linearized,
    robust_scales,
)

_ITERATIONS = 30
"""Steps at most. Numerical: it converges in about ten, in thirty from very wrong starts."""
_FIRST_DAMPING = 1e-3
"""Factor on the diagonal of the normal equations. Numerical: Levenberg-Marquardt."""
_MAX_DAMPING = 1e4
"""Factor on the diagonal. Numerical: with more a step is too short to help, so that it ends."""
_CONVERGED = 0.05
"""Gain in the negative logarithm of the likelihood. Numerical: a step that gains less moves no
unknown by more than a third of its standard deviation."""
_MAX_LENS_STEP = 0.3
"""Per step, of the logarithm of a focal length and of a radial coefficient. Numerical."""
_ROUNDS = 2
"""Rounds with scales of their own. Numerical: those of the first lens are not those of the last."""


@dataclass(frozen=True, slots=True, eq=False)
class LensUnknowns:
    """Which coefficients of lenses are unknown, and what is known of them before.

    Attributes
    ----------
    column : (C, 2) ndarray of int
        Number of the unknown of each coefficient of each camera; cameras with one lens have the
        same; -1: it is known.
    known : (C, 2) ndarray
        Coefficients that are.
    start : (U,) ndarray
        Values to start from; too wide a view is a better start than too narrow a one.
    mean, stddev : (U,) ndarray
        Gaussian prior of each unknown.
    """

    column: IntArray
    known: Float64Array
    start: Float64Array
    mean: Float64Array
    stddev: Float64Array

    def values(self, lenses: Float64Array) -> Float64Array:
        """Return the unknowns (U,) of lenses (C, 2)."""
        found = np.zeros(len(self.mean))
        free = self.column >= 0
        found[self.column[free]] = lenses[free]
        return found

    def steps(self, values: Float64Array) -> Float64Array:
        """Return what belongs to the unknowns (U,) for each coefficient (C, 2); 0 where known."""
        return np.where(self.column >= 0, values[self.column], 0.0)

    def lenses(self, values: Float64Array) -> Float64Array:
        """Return lenses (C, 2) of unknowns (U,)."""
        return np.where(self.column >= 0, values[self.column], self.known)

    def prior_cost(self, lenses: Float64Array) -> float:
        """Return the negative logarithm of the prior."""
        return float(0.5 * (((self.values(lenses) - self.mean) / self.stddev) ** 2).sum())


@dataclass(frozen=True, slots=True, eq=False)
class FoundLenses:
    """Result of the search.

    Attributes
    ----------
    views : TwoViews
        Lenses of the cameras, and relative poses of the pairs.
    stddev : (C, 2) ndarray
        Standard deviations of the lenses; 0 where known.
    """

    views: TwoViews
    stddev: Float64Array


def search_lenses(points: PairPoints, unknowns: LensUnknowns) -> FoundLenses:
    """Find the lenses with which all pairs have an essential matrix.

    Parameters
    ----------
    points : PairPoints
    unknowns : LensUnknowns
    """
    views = first_views(points, unknowns.lenses(unknowns.start))
    for _ in range(_ROUNDS):
        scales = robust_scales(points, views)
        views = _minimized(points, unknowns, views, scales)
    covariance = np.linalg.inv(_normal_equations(points, unknowns, views, scales).reduced(0.0)[0])
    return FoundLenses(views, unknowns.steps(np.sqrt(np.diag(covariance))))


def _minimized(
    points: PairPoints, unknowns: LensUnknowns, views: TwoViews, scales: Float64Array
) -> TwoViews:
    """Levenberg-Marquardt on poses and lenses."""
    cost = _cost(points, unknowns, views, scales)
    damping = _FIRST_DAMPING
    for _ in range(_ITERATIONS):
        normal = _normal_equations(points, unknowns, views, scales)
        while damping < _MAX_DAMPING:
            trial = _stepped(unknowns, views, normal, damping)
            trial_cost = _cost(points, unknowns, trial, scales)
            if trial_cost < cost:
                break
            damping *= 10.0
        else:
            break
        gain, views, cost, damping = cost - trial_cost, trial, trial_cost, damping / 5.0
        if gain < _CONVERGED:
            break
    return views


def _cost(
    points: PairPoints, unknowns: LensUnknowns, views: TwoViews, scales: Float64Array
) -> float:
    """Negative logarithm of the likelihood and the prior."""
    loss = np.log1p((distances_px(points, views) / scales[:, None]) ** 2)
    weighted = _weights(points) * loss * (NOISE_MARGIN**2 / 2.0)
    return float(weighted.sum()) + unknowns.prior_cost(views.lenses)


def _weights(points: PairPoints) -> Float64Array:
    """Independent measurements (P, M) that each point is worth."""
    count = np.maximum(points.observed.sum(-1), 1)
    return np.asarray(points.observed * (points.independent / count)[:, None])


@dataclass(frozen=True, slots=True, eq=False)
class _NormalEquations:
    """Blocks of the pairs (P, 6, 6), of the lenses (U, U), and between them (P, 6, U)."""

    H_pair: Float64Array
    H_both: Float64Array
    H_lens: Float64Array
    g_pair: Float64Array
    g_lens: Float64Array

    def reduced(self, damping: float) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Eliminate the pairs: matrix, gradient, and the inverse blocks (P, 6, 6)."""
        H = self.H_pair.copy()
        each = range(OF_PAIR)
        H[:, each, each] *= 1.0 + damping
        H[:, each, each] += 1e-9 * np.trace(H, axis1=1, axis2=2)[:, None]
        inverse = np.linalg.inv(H)
        across = np.swapaxes(self.H_both, -1, -2) @ inverse
        S = self.H_lens + damping * np.diag(np.diag(self.H_lens)) - (across @ self.H_both).sum(0)
        return S, self.g_lens - (across @ self.g_pair[..., None])[..., 0].sum(0), inverse


def _normal_equations(
    points: PairPoints, unknowns: LensUnknowns, views: TwoViews, scales: Float64Array
) -> _NormalEquations:
    distances, J = linearized(points, views)
    r, J = distances / scales[:, None], J / scales[:, None, None]
    w = NOISE_MARGIN**2 * _weights(points) / (1.0 + r**2)
    weighted = np.swapaxes(J * w[..., None], -1, -2)
    H, g = weighted @ J, (weighted @ r[..., None])[..., 0]
    columns = np.concatenate([unknowns.column[points.a], unknowns.column[points.b]], -1)
    chosen = (columns[..., None] == np.arange(len(unknowns.mean))).astype(np.float64)
    of_lenses = np.swapaxes(chosen, -1, -2)
    H_lens = (of_lenses @ H[:, OF_PAIR:, OF_PAIR:] @ chosen).sum(0)
    g_lens = (of_lenses @ g[:, OF_PAIR:, None]).sum(0)[:, 0]
    return _NormalEquations(
        H[:, :OF_PAIR, :OF_PAIR],
        H[:, :OF_PAIR, OF_PAIR:] @ chosen,
        H_lens + np.diag(unknowns.stddev**-2),
        g[:, :OF_PAIR],
        g_lens + (unknowns.values(views.lenses) - unknowns.mean) / unknowns.stddev**2,
    )


def _stepped(
    unknowns: LensUnknowns, views: TwoViews, normal: _NormalEquations, damping: float
) -> TwoViews:
    S, g, inverse = normal.reduced(damping)
    step = -np.linalg.solve(S, g)
    of_pairs = -(inverse @ (normal.g_pair + normal.H_both @ step)[..., None])[..., 0]
    step = np.clip(step, -_MAX_LENS_STEP, _MAX_LENS_STEP)
    moved = views.moved(of_pairs, unknowns.steps(step))
    bounds = np.array([FOCAL_BOUNDS, RADIAL_BOUNDS]).T
    lenses = np.clip(moved.lenses, *bounds)
    return TwoViews(lenses, moved.R_a_b, moved.unit_t, moved.lag_s)
