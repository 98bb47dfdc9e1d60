"""Spatiotemporal bundle adjustment (Section IV).

Minimises the robust reprojection error of ``X^c = X + (phi + d_c) V`` over camera poses,
clock offsets d_c and joint positions X, with the joint velocities V read from the present
trajectories; their curvature is added, so that only a change of acceleration within half a
frame is neglected. The points are eliminated (Schur complement), so that one step costs a batch
of closed-form 3x3 factorisations and one matrix product.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.normal_equations import (
    BackSubstitution,
    Block,
    Linearisation,
    ReducedSystem,
)
from stcalib_ros.core.bundle.observations import Observations, blocks_of
from stcalib_ros.core.bundle.parameters import WORLD_STEP, Cameras, ParameterLayout
from stcalib_ros.core.bundle.residuals import noise_px
from stcalib_ros.core.bundle.state import BundleState, estimate_motion
from stcalib_ros.core.geometry.robust import CAUCHY
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray

Motion = Callable[[Observations, Float64Array, BoolArray], tuple[Float64Array, Float64Array]]
"""Reads velocities and accelerations (N, J, 3) from joints, those present (N, J) only."""

_MIN_RENEWALS = 4
"""Count. Steps with velocities read anew before an adjustment may end. Numerical."""

_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING, _DAMPING_FACTOR = 1e-5, 1e-9, 1e4, 10.0
"""Fractions of the diagonal, and their ratio from step to step. Numerical: the usual choice of
Levenberg and Marquardt; starts are near the optimum."""


def adjust(
    obs: Observations,
    state: BundleState,
    *,
    iterations: int,
    tolerance: float,
    renew_velocities: bool = False,
    layout: ParameterLayout | None = None,
    motion: Motion = estimate_motion,
    settle_points: bool = False,
) -> BundleState:
    """Levenberg-Marquardt on the robust cost.

    Parameters
    ----------
    obs : Observations
    state : BundleState
        Start.
    iterations : int
        Steps at most.
    tolerance : float
        Done when a step moves the cameras by less than this many standard deviations (root
        of the squared Mahalanobis length).
    renew_velocities : bool
        Read V from the trajectories again after every step; else it stays as it is.
    layout : ParameterLayout, optional
        Unknowns that are estimated; default: poses and time offsets.
    motion : callable
        How V and A are read.
    settle_points : bool
        Let the points take a step of their own after each of the cameras: where their depths change
        by much, they do not follow in a straight line.
    """
    damping = _FIRST_DAMPING
    scale = CAUCHY * noise_px(obs, state)
    problem = PointProblem(obs, state, scale, layout)
    least = _MIN_RENEWALS if renew_velocities else 0
    for step in range(iterations):
        here = problem.reduce(damping)
        there = problem.apply_step(here)
        if settle_points:
            there = there.settled()
        if there.cost < here.cost:
            problem = there.problem
            damping = max(damping / _DAMPING_FACTOR, _LEAST_DAMPING)
            if renew_velocities:
                state = problem.state_of(state)
                V, A = motion(obs, state.X, state.triangulated())
                state = replace(state, V=V, A=A)
                problem = PointProblem(obs, state, scale, layout)
            if there.length < tolerance and step >= least:
                break
        else:
            damping *= _DAMPING_FACTOR
            if damping > _MOST_DAMPING:
                break
    return problem.state_of(state)


def time_sums(
    obs: Observations, state: BundleState, group: IntArray
) -> tuple[Float64Array, Float64Array]:
    """Normal equations of the times of the images of groups of rows, cameras given.

    Parameters
    ----------
    obs : Observations
    state : BundleState
    group : (N,) ndarray of int
        Number of the group of each row; each camera has one time in each.

    Returns
    -------
    H : (K, C, C) ndarray
    g : (K, C) ndarray
        Both in units of the noise of the image points, the points eliminated.
    """
    sigma = noise_px(obs, state)
    problem = PointProblem(obs, state, CAUCHY * sigma)
    K, C, J = int(group.max()) + 1, *obs.observed.shape[1:]
    H, g = np.zeros((K, C, C)), np.zeros((K, C))
    for block, at in problem.linearised():
        number = group[block.points // J]
        h, y, right = at.by_time(problem.scale)
        for c in range(C):
            g[:, c] += np.bincount(number, right[c], K)
            H[:, c, c] += np.bincount(number, h[c], K)
            for d in range(C):
                H[:, c, d] -= np.bincount(number, (y[:, c] * y[:, d]).sum(0), K)
    return H / sigma**2, g / sigma**2


def cluster_scores(
    obs: Observations, state: BundleState, cluster: IntArray, layout: ParameterLayout | None = None
) -> tuple[ReducedSystem, Float64Array]:
    """Undamped reduced normal equations at a state, and what clusters of points add to them.

    Parameters
    ----------
    obs : Observations
    state : BundleState
    cluster : (N, J) ndarray of int
        Number of the cluster that each point belongs to.
    layout : ParameterLayout, optional
        Default: poses and time offsets.

    Returns
    -------
    system : ReducedSystem
    scores : (layout.size, n) ndarray
        Part of each cluster in the gradient; their sum is ``system.g``.
    """
    sigma = noise_px(obs, state)
    problem = PointProblem(obs, state, CAUCHY * sigma, layout)
    labels, n = cluster.ravel(), int(cluster.max(initial=-1)) + 1
    k = problem.layout.size
    H, g, scores = np.zeros((k, k)), np.zeros(k), np.zeros((k, n))
    for block, at in problem.linearised():
        system, of_points = at.scores(problem.scale)
        H += system.H
        g += system.g
        mine = labels[block.points]
        for i, one in enumerate(of_points):
            scores[i] += np.bincount(mine, weights=one, minlength=n)
    return ReducedSystem(H, g), scores


@dataclass(frozen=True, slots=True, eq=False)
class ReducedProblem:
    """The adjustment at one state: its robust cost, and the system with the points eliminated."""

    cost: float
    system: ReducedSystem
    eliminated: Sequence[BackSubstitution]


@dataclass(frozen=True, slots=True, eq=False)
class SolverStep:
    """The adjustment after a step.

    Attributes
    ----------
    problem : PointProblem
    cost : float
        Robust cost there.
    length : float
        How many standard deviations the cameras moved.
    """

    problem: PointProblem
    cost: float
    length: float

    def settled(self) -> SolverStep:
        """The same after another step of the points alone."""
        problem = self.problem
        X, cost = problem.state.X.copy(), problem.prior_cost(problem.cameras)
        flat_X = X.reshape(-1, 3)
        for block, at in problem.linearised():
            flat_X[block.points] = at.settled(problem.scale)
            moved = flat_X[block.points]
            cost += block.at(problem.cameras, moved).cost(problem.scale)
        state = replace(problem.state, X=X)
        settled = PointProblem(problem.obs, state, problem.scale, problem.layout)
        return replace(self, problem=settled, cost=cost)


class PointProblem:
    """The adjustment at one state of the unknowns; V, A and the choice of points are given."""

    def __init__(
        self,
        obs: Observations,
        state: BundleState,
        scale: float,
        layout: ParameterLayout | None = None,
    ) -> None:
        self.obs, self.state, self.scale = obs, state, scale
        self.layout = layout or state.layout
        self.cameras = state.cameras

    def blocks(self) -> Iterator[Block]:
        """All points, a block at a time."""
        for rows in blocks_of(self.obs):
            yield Block(self.obs, self.state.inlier, self.state.V, self.state.A, rows)

    def linearised(self) -> Iterator[tuple[Block, Linearisation]]:
        """The same with their predictions."""
        X = self.state.X.reshape(-1, 3)
        for block in self.blocks():
            yield block, block.at(self.cameras, X[block.points], self.layout)

    def reduce(self, damping: float) -> ReducedProblem:
        """Eliminate the points."""
        n = self.layout.size
        H, g, diagonal, cost = np.zeros((n, n)), np.zeros(n), np.zeros(n), 0.0
        eliminated = []
        for _, at in self.linearised():
            system, part, points, _ = at.reduce(self.scale, damping)
            H += system.H
            g += system.g
            diagonal += part
            cost += at.cost(self.scale)
            eliminated.append(points)
        H[range(n), range(n)] += damping * diagonal
        information, deviation = self.prior(self.cameras)
        H[range(n), range(n)] += information
        g += information * deviation
        cost += self.prior_cost(self.cameras)
        return ReducedProblem(cost, ReducedSystem(H, g), eliminated)

    def prior(self, cameras: Cameras) -> tuple[Float64Array, Float64Array]:
        """What was known of the lenses: weights (n,) in px^2, and deviations from it."""
        information, deviation = self.layout.prior(cameras, world_stddev=WORLD_STEP)
        correlated = 1.0 if cameras.lenses is None else cameras.lenses.correlated
        return correlated * (self.scale / CAUCHY) ** 2 * information, deviation

    def prior_cost(self, cameras: Cameras) -> float:
        """Its part of the robust cost."""
        information, deviation = self.prior(cameras)
        return float(information @ deviation**2) / self.scale**2

    def apply_step(self, by: ReducedProblem) -> SolverStep:
        """The problem after the step of a system; the pose of the reference and the scale stay."""
        system = by.system
        d_camera = -self.layout.solve(system.H, system.g, self.cameras)
        flat = d_camera.ravel()
        length = np.sqrt(max(float(flat @ system.H @ flat), 0.0)) * CAUCHY / self.scale
        cameras = self.layout.retract(self.cameras, d_camera)
        X, cost = self.state.X.copy(), self.prior_cost(cameras)
        flat_X = X.reshape(-1, 3)
        for (block, at), points in zip(self.linearised(), by.eliminated, strict=True):
            moved = at.back_substitute(points, self.scale, d_camera)
            flat_X[block.points] = moved
            cost += block.at(cameras, moved).cost(self.scale)
        state = replace(self.state.with_cameras(cameras), X=X)
        return SolverStep(
            PointProblem(self.obs, state, self.scale, self.layout), cost, float(length)
        )

    def state_of(self, before: BundleState) -> BundleState:
        """The state in the reference frame, the length of the gauge exactly what it was before."""
        scaled = self.state.scaled(before.cameras.length() / self.cameras.length())
        return scaled.in_reference_frame()
