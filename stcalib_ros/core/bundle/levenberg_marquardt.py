"""Spatiotemporal bundle adjustment (Section IV).

Minimises the robust reprojection error of ``X^c = X + (phi + d_c) V`` over camera poses,
clock offsets d_c and joint positions X, with the joint velocities V read from the present
trajectories; their curvature is added, so that only a change of acceleration within half a
frame is neglected. The points are eliminated (Schur complement), so that one step costs a batch
of closed-form 3x3 factorisations and one matrix product.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.normal_equations import (
    CAMERA,
    BackSubstitution,
    Block,
    Cameras,
    Linearisation,
    ReducedSystem,
)
from stcalib_ros.core.bundle.observations import Observations, blocks_of
from stcalib_ros.core.bundle.residuals import errors_px, robust_scale
from stcalib_ros.core.bundle.state import BundleState, estimate_motion
from stcalib_ros.core.geometry.robust import CAUCHY, MIN_SCALE_PX
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.arrays import Float64Array, IntArray

_MIN_RENEWALS = 4


def adjust(
    o: Observations,
    state: BundleState,
    *,
    iterations: int,
    tolerance: float,
    renew_velocities: bool = False,
) -> BundleState:
    """Levenberg-Marquardt on the robust cost.

    Parameters
    ----------
    o : Observations
    state : BundleState
        Start.
    iterations : int
        Steps at most.
    tolerance : float
        Done when a step moves the cameras by less than this many standard deviations (root
        of the squared Mahalanobis length).
    renew_velocities : bool
        Read V from the trajectories again after every step; else it stays as it is.
    """
    damping = 1e-5
    scale = CAUCHY * max(robust_scale(errors_px(o, state), state.used), MIN_SCALE_PX)
    problem = PointProblem(o, state, scale)
    least = _MIN_RENEWALS if renew_velocities else 0
    for step in range(iterations):
        here = problem.reduce(damping)
        there = problem.moved(here)
        if there.cost < here.cost:
            problem = there.problem
            damping = max(damping / 10.0, 1e-9)
            if renew_velocities:
                state = problem.state_of(state)
                V, A = estimate_motion(o, state.X, state.used.sum(1) >= 2)
                state = replace(state, V=V, A=A)
                problem = PointProblem(o, state, scale)
            if there.length < tolerance and step >= least:
                break
        else:
            damping *= 10.0
            if damping > 1e4:
                break
    return problem.state_of(state)


def reduced_by_group(
    o: Observations, state: BundleState, group: IntArray
) -> tuple[Float64Array, Float64Array]:
    """Undamped reduced normal equations of groups of rows.

    Parameters
    ----------
    o : Observations
    state : BundleState
    group : (N,) ndarray of int
        Number of the group of each row.

    Returns
    -------
    H : (K, 7 C, 7 C) ndarray
    g : (K, 7 C) ndarray
        Both in units of the noise of the image points.
    """
    sigma = max(robust_scale(errors_px(o, state), state.used), MIN_SCALE_PX)
    H, g = [], []
    for k in range(int(group.max()) + 1):
        rows = np.flatnonzero(group == k)
        problem = PointProblem(o.only(rows), state.only(rows), CAUCHY * sigma)
        system = problem.reduce(0.0).system
        H.append(system.H / sigma**2)
        g.append(system.g / sigma**2)
    return np.stack(H), np.stack(g)


def time_sums(
    o: Observations, state: BundleState, group: IntArray
) -> tuple[Float64Array, Float64Array]:
    """Normal equations of the times of the images of groups of rows, cameras given.

    Parameters
    ----------
    o : Observations
    state : BundleState
    group : (N,) ndarray of int
        Number of the group of each row; each camera has one time in each.

    Returns
    -------
    H : (K, C, C) ndarray
    g : (K, C) ndarray
        Both in units of the noise of the image points, the points eliminated.
    """
    sigma = max(robust_scale(errors_px(o, state), state.used), MIN_SCALE_PX)
    problem = PointProblem(o, state, CAUCHY * sigma)
    K, C, J = int(group.max()) + 1, *o.seen.shape[1:]
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
    o: Observations, state: BundleState, cluster: IntArray
) -> tuple[ReducedSystem, Float64Array]:
    """Undamped reduced normal equations at a state, and what clusters of points add to them.

    Parameters
    ----------
    o : Observations
    state : BundleState
    cluster : (N, J) ndarray of int
        Number of the cluster that each point belongs to.

    Returns
    -------
    system : ReducedSystem
    scores : (7 C, n) ndarray
        Share of each cluster in the gradient; their sum is ``system.g``.
    """
    sigma = max(robust_scale(errors_px(o, state), state.used), MIN_SCALE_PX)
    problem = PointProblem(o, state, CAUCHY * sigma)
    labels, n = cluster.ravel(), int(cluster.max(initial=-1)) + 1
    k = CAMERA * len(state.t_cam_ref)
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
class Step:
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


class PointProblem:
    """The adjustment at one state of the unknowns; V, A and the choice of points are given."""

    def __init__(self, o: Observations, state: BundleState, scale: float) -> None:
        self.o, self.state, self.scale = o, state, scale
        self.cameras = Cameras(state.R_cam_ref, state.t_cam_ref, state.shift_s)

    def blocks(self) -> Iterator[Block]:
        """All points, a block at a time."""
        for rows in blocks_of(self.o):
            yield Block(self.o, self.state.used, self.state.V, self.state.A, rows)

    def linearised(self) -> Iterator[tuple[Block, Linearisation]]:
        """The same with their predictions."""
        X = self.state.X.reshape(-1, 3)
        for block in self.blocks():
            yield block, block.at(self.cameras, X[block.points])

    def reduce(self, damping: float) -> ReducedProblem:
        """Eliminate the points."""
        n = CAMERA * len(self.cameras.t)
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
        return ReducedProblem(cost, ReducedSystem(H, g), eliminated)

    def moved(self, by: ReducedProblem) -> Step:
        """The problem after the step of a system; the reference pose and the scale stay."""
        system = by.system
        d_camera = -solve_reduced(system, self.cameras.t, synchronised=self.state.synchronised)
        flat = d_camera.ravel()
        length = np.sqrt(max(float(flat @ system.H @ flat), 0.0)) * CAUCHY / self.scale
        cameras = Cameras(
            exp_so3(d_camera[:, :3]) @ self.cameras.R,
            self.cameras.t + d_camera[:, 3:6],
            self.cameras.shift + d_camera[:, 6],
        )
        X, cost = self.state.X.copy(), 0.0
        flat_X = X.reshape(-1, 3)
        for (block, at), points in zip(self.linearised(), by.eliminated, strict=True):
            moved = at.followed(points, self.scale, d_camera)
            flat_X[block.points] = moved
            cost += block.at(cameras, moved).cost(self.scale)
        state = replace(
            self.state, R_cam_ref=cameras.R, t_cam_ref=cameras.t, shift_s=cameras.shift, X=X
        )
        return Step(PointProblem(self.o, state, self.scale), cost, float(length))

    def state_of(self, before: BundleState) -> BundleState:
        """The state, the scale put back exactly to what it was before."""
        length = float(np.linalg.norm(before.t_cam_ref[1]))
        factor = length / float(np.linalg.norm(self.cameras.t[1]))
        scaled = {n: getattr(self.state, n) * factor for n in ("t_cam_ref", "X", "V", "A")}
        return replace(self.state, **scaled)


def gauge(t_cam_ref: Float64Array, *, synchronised: bool = False) -> tuple[IntArray, Float64Array]:
    """Free parameters and the direction of the scale among the camera unknowns.

    Returns
    -------
    free : (7 C - 7,) ndarray of int
        All but those of the reference camera, and but the offsets of synchronised ones.
    scale : (7 C,) ndarray
        Unit vector along which the first baseline grows.
    """
    C = len(t_cam_ref)
    scale = np.zeros(CAMERA * C)
    scale[CAMERA + 3 : CAMERA + 6] = t_cam_ref[1] / np.linalg.norm(t_cam_ref[1])
    free = np.arange(CAMERA, CAMERA * C, dtype=np.int64)
    return free[free % CAMERA != CAMERA - 1] if synchronised else free, scale


def solve_reduced(
    system: ReducedSystem, t_cam_ref: Float64Array, *, synchronised: bool = False
) -> Float64Array:
    """Solution (C, 7) of the reduced system with the reference and the first baseline fixed."""
    free, scale = gauge(t_cam_ref, synchronised=synchronised)
    H = system.H + 1e6 * np.diag(system.H).max() * np.outer(scale, scale)
    H = H[np.ix_(free, free)]
    H[range(len(H)), range(len(H))] += 1e-12 * np.trace(H)
    out = np.zeros(len(system.g))
    out[free] = np.linalg.solve(H, system.g[free])
    return out.reshape(-1, CAMERA)
