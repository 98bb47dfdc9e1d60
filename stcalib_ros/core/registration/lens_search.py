"""Lenses that are not known, by what all pairs of cameras agree on.

The matrix that explains two tracks is a fundamental one: persons and lags are found without the
focal lengths. That it is an essential one for the right lenses is one or two constraints per pair.
They are solved together: the relative poses of all pairs and the lenses of all cameras minimize
the robust Sampson distances, the turns of `rotation_loops`, and the priors of the lenses.

Pairs alone do not determine everything. Where all optical axes meet in one point, spheres about it
are seen in every image as circles about the principal point, as the absolute conic is, and one
factor of all focal lengths is free; it is the loops that determine it. Of two cameras, most is
left to the priors. The standard deviations say so.

References
----------
P. Sturm, "On focal length calibration from two views", 2001, and "Critical motion sequences for
the self-calibration of cameras and stereo systems with variable focal length", 2002.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.geometry.robust import NOISE_MARGIN
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.registration.limits import FOCAL_BOUNDS, LOOP_SCALES, RADIAL_BOUNDS
from stcalib_ros.core.registration.rotation_loops import RotationLoops, rotation_loops
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
"""Steps at most. Numerical: it converges in about five, in thirty from very wrong starts."""
_FIRST_DAMPING = 1e-3
"""Factor on the diagonal of the normal equations. Numerical: Levenberg-Marquardt."""
_MAX_DAMPING = 1e4
"""Factor on the diagonal. Numerical: with more a step is too short to help, so that it ends."""
_CONVERGED = 0.01
"""Gain in the negative logarithm of the likelihood by which it has converged. Numerical: with 0.05
it ends amid the narrow valley of one factor of all focal lengths, where steps are short."""
_MAX_LENS_STEP = 0.3
"""Per step, of the logarithm of a focal length and of a radial coefficient. Numerical."""
_RIDGE = 1e-9
"""Ratio to the mean diagonal of the pairs. Numerical: standing people do not determine a lag."""


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
    """Find the lenses with which all pairs have an essential matrix, and fit together.

    Parameters
    ----------
    points : PairPoints
    unknowns : LensUnknowns
    """
    views = first_views(points, unknowns.lenses(unknowns.start))
    loops = rotation_loops(points.a, points.b)
    for scale in LOOP_SCALES:
        costs = _Costs(points, unknowns, loops, robust_scales(points, views), scale)
        views = costs.minimized(views)
    variance = np.diag(np.linalg.inv(costs.normal_equations(views)[0]))
    return FoundLenses(views, unknowns.steps(np.sqrt(variance[costs.n_poses :])))


@dataclass(frozen=True, slots=True, eq=False)
class _Costs:
    """Negative logarithm of likelihood and priors.

    Attributes
    ----------
    scales_px : (P,) ndarray
        Scales of the Cauchy loss on the distances of each pair, px.
    loop_rad : float
        Scale of that on the turns of loops, rad.
    """

    points: PairPoints
    unknowns: LensUnknowns
    loops: RotationLoops
    scales_px: Float64Array
    loop_rad: float

    @property
    def n_poses(self) -> int:
        """Unknowns of all pairs, which come before those of the lenses."""
        return OF_PAIR * len(self.points.a)

    def minimized(self, views: TwoViews) -> TwoViews:
        """Return the poses and lenses of the least cost (Levenberg-Marquardt)."""
        cost, damping = self.of(views), _FIRST_DAMPING
        for _ in range(_ITERATIONS):
            normal = self.normal_equations(views)
            while damping < _MAX_DAMPING:
                trial = self._stepped(views, *normal, damping)
                trial_cost = self.of(trial)
                if trial_cost < cost:
                    break
                damping *= 10.0
            else:
                break
            gain, views, cost, damping = cost - trial_cost, trial, trial_cost, damping / 5.0
            if gain < _CONVERGED:
                break
        return views

    def of(self, views: TwoViews) -> float:
        """Return the cost of poses and lenses."""
        r = distances_px(self.points, views) / self.scales_px[:, None]
        turns = self.loops.turns(views.R_a_b) / self.loop_rad
        of_points = NOISE_MARGIN**2 / 2.0 * float((self._weights() * np.log1p(r**2)).sum())
        of_loops = self.loops.share * float(np.log1p((turns**2).sum(-1)).sum())
        return of_points + of_loops + self.unknowns.prior_cost(views.lenses)

    def _weights(self) -> Float64Array:
        """Independent measurements (P, M) that each point is worth."""
        observed = self.points.observed
        return np.asarray(observed * (self.points.independent / observed.sum(-1))[:, None])

    def normal_equations(self, views: TwoViews) -> tuple[Float64Array, Float64Array]:
        """Return H and g of the poses of all pairs and then of the unknowns of the lenses."""
        n, size = self.n_poses, self.n_poses + len(self.unknowns.mean)
        H, g = np.zeros((size, size)), np.zeros(size)
        self._add_points(H, g, views)
        self._add_loops(H, g, views)
        away = self.unknowns.values(views.lenses) - self.unknowns.mean
        H[range(n, size), range(n, size)] += self.unknowns.stddev**-2
        g[n:] += away / self.unknowns.stddev**2
        H[range(n), range(n)] += _RIDGE * np.trace(H[:n, :n]) / n
        return H, g

    def _add_points(self, H: Float64Array, g: Float64Array, views: TwoViews) -> None:
        distances, J = linearized(self.points, views)
        r, J = distances / self.scales_px[:, None], J / self.scales_px[:, None, None]
        w = NOISE_MARGIN**2 * self._weights() / (1.0 + r**2)
        J_t = np.swapaxes(J * w[..., None], -1, -2)
        own = np.arange(self.n_poses).reshape(-1, OF_PAIR)
        column = np.where(self.unknowns.column >= 0, self.n_poses + self.unknowns.column, -1)
        columns = np.concatenate([own, column[self.points.a], column[self.points.b]], -1)
        free = columns >= 0
        np.add.at(g, columns[free], (J_t @ r[..., None])[..., 0][free])
        both = free[:, :, None] & free[:, None]
        rows, others = np.broadcast_arrays(columns[:, :, None], columns[:, None])
        np.add.at(H, (rows[both], others[both]), (J_t @ J)[both])

    def _add_loops(self, H: Float64Array, g: Float64Array, views: TwoViews) -> None:
        turns = self.loops.turns(views.R_a_b) / self.loop_rad
        w = 2.0 * self.loops.share / (1.0 + (turns**2).sum(-1))
        parts = self.loops.derivatives(views.R_a_b)
        for pair, J in parts:
            rows = OF_PAIR * pair[:, None] + np.arange(3)
            J_t = np.swapaxes(J, -1, -2) * (w / self.loop_rad)[:, None, None]
            np.add.at(g, rows, (J_t @ turns[..., None])[..., 0])
            for other, J_other in parts:
                columns = OF_PAIR * other[:, None] + np.arange(3)
                np.add.at(H, (rows[:, :, None], columns[:, None]), J_t @ J_other / self.loop_rad)

    def _stepped(
        self, views: TwoViews, H: Float64Array, g: Float64Array, damping: float
    ) -> TwoViews:
        step = np.asarray(-np.linalg.solve(H + damping * np.diag(np.diag(H)), g), np.float64)
        of_pairs = step[: self.n_poses].reshape(-1, OF_PAIR)
        of_lenses = np.clip(step[self.n_poses :], -_MAX_LENS_STEP, _MAX_LENS_STEP)
        moved = views.moved(of_pairs, self.unknowns.steps(of_lenses))
        lenses = np.clip(moved.lenses, *np.transpose([FOCAL_BOUNDS, RADIAL_BOUNDS]))
        return replace(moved, lenses=lenses)
