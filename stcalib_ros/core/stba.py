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
from itertools import pairwise

import numpy as np

from stcalib_ros.core.averaging import Rig
from stcalib_ros.core.geometry import exp_so3, triangulate
from stcalib_ros.core.motion import local_motion, smooth_motion
from stcalib_ros.core.observations import Observations
from stcalib_ros.core.reduction import (
    CAMERA,
    NEAREST,
    Block,
    Cameras,
    Eliminated,
    Linearisation,
    ReducedSystem,
    row_blocks,
)
from stcalib_ros.core.types import BoolArray, FloatArray, IntArray

CAUCHY = 2.385
RAYLEIGH_MEDIAN = 1.17741
MIN_SCALE_PX = 0.5
LEAST_SHARE = 0.2
_MIN_RENEWALS = 4
_HALF_WINDOW_S = 0.2
_MIN_HALF_WINDOW = 6


@dataclass(frozen=True, slots=True, eq=False)
class BundleState:
    """Unknowns of the adjustment.

    Attributes
    ----------
    R_cam_ref : (C, 3, 3) ndarray
    t_cam_ref : (C, 3) ndarray
        ``x_cam = R_cam_ref @ x_ref + t_cam_ref``; those of the reference are fixed.
    shift_s : (C,) ndarray
        Correction of the offsets that `Observations.phi` was computed with.
    X : (N, J, 3) ndarray
        Joints at the knots in the reference frame.
    V, A : (N, J, 3) ndarray
        Velocities and accelerations, per second and squared second.
    used : (N, C, J) ndarray of bool
        Observations that take part.
    synchronised : bool
        The clocks are known to agree: `shift_s` is zero and no unknown.
    """

    R_cam_ref: FloatArray
    t_cam_ref: FloatArray
    shift_s: FloatArray
    X: FloatArray
    V: FloatArray
    A: FloatArray
    used: BoolArray
    synchronised: bool = False

    def only(self, rows: IntArray | BoolArray) -> BundleState:
        """The same with some rows only."""
        names = ("X", "V", "A", "used")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})


def initial_state(o: Observations, rig: Rig) -> BundleState:
    """Triangulate everything with the poses of a rig and estimate the velocities.

    Done twice: the second time every ray starts where the motion since the knot puts it.
    """
    R_cam_ref = np.swapaxes(rig.R_ref_cam, -1, -2).copy()
    t_cam_ref = -np.einsum("cij,cj->ci", R_cam_ref, rig.t_ref_cam)
    N, _, J = o.seen.shape
    V, A = np.zeros((2, N, J, 3))
    for _ in range(2):
        X, good = _triangulated(o, rig, V, A)
        V, A = motion(o, X, good)
    shift_s, used = np.zeros(len(R_cam_ref)), o.seen & good[:, None, :]
    return BundleState(R_cam_ref, t_cam_ref, shift_s, X, V, A, used, rig.synchronised)


def _triangulated(
    o: Observations, rig: Rig, V: FloatArray, A: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Joints (N, J, 3) where rays that start as far on as the joints have moved come closest."""
    N, _, J = o.seen.shape
    X, good = np.zeros((N, J, 3)), np.zeros((N, J), dtype=bool)
    for rows in _blocks(o):
        when = o.elapsed(rows).transpose(0, 2, 1)[..., None]
        moved = when * (V[rows, :, None] + 0.5 * when * A[rows, :, None])
        weight = o.seen[rows].transpose(0, 2, 1).astype(float)
        found, good[rows] = triangulate(
            rig.t_ref_cam - moved, _rays(o.x[rows], rig), weight, refinements=1
        )
        X[rows] = np.where(good[rows, :, None], found, 0.0)
    return X, good


def _rays(x: FloatArray, rig: Rig) -> FloatArray:
    """Unit rays (N, J, C, 3) of image points (N, C, J, 2) in the reference frame."""
    b = np.concatenate([x, np.ones_like(x[..., :1])], -1)
    b /= np.linalg.norm(b, axis=-1, keepdims=True)
    turned = b @ np.swapaxes(rig.R_ref_cam, -1, -2)
    return np.asarray(turned.transpose(0, 2, 1, 3))


def motion(
    o: Observations, X: FloatArray, present: BoolArray, *, smooth_s: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Velocities and accelerations (N, J, 3) by a local fit along each person's knots.

    Of noisy points with `smooth_s`: by cubics over so many seconds to either side.
    """
    half_window = max(_MIN_HALF_WINDOW, round((smooth_s or _HALF_WINDOW_S) / o.step_s))
    fit = smooth_motion if smooth_s else local_motion
    V, A = np.zeros((2, *X.shape))
    for rows in persons_of(o):
        knots = o.knot[rows] - o.knot[rows][0]
        n = int(knots[-1]) + 1
        path, there = np.zeros((n, *X.shape[1:])), np.zeros((n, X.shape[1]), dtype=bool)
        path[knots], there[knots] = X[rows], present[rows]
        per_step, per_step2 = fit(path, there, half_window=half_window)
        V[rows], A[rows] = per_step[knots] / o.step_s, per_step2[knots] / o.step_s**2
    return V, A


def persons_of(o: Observations) -> Iterator[slice]:
    """Rows of one person after the other."""
    edges = np.flatnonzero(np.diff(o.person)) + 1
    bounds = [0, *edges.tolist(), len(o.person)]
    for begin, end in pairwise(bounds):
        if end > begin:
            yield slice(begin, end)


def at_images(
    o: Observations, state: BundleState, rows: slice | IntArray = slice(None)
) -> FloatArray:
    """Joints (N, C, J, 3) in the reference frame at the time of each camera's image."""
    when = (o.elapsed(rows) + state.shift_s[:, None])[..., None]
    V, A = state.V[rows][:, None], state.A[rows][:, None]
    return np.asarray(state.X[rows][:, None] + when * (V + 0.5 * when * A))


def residuals_px(
    o: Observations, state: BundleState, rows: slice = slice(None)
) -> tuple[FloatArray, BoolArray]:
    """Reprojection residuals (N, C, J, 2), px, and which of them take part and are finite."""
    R = np.swapaxes(state.R_cam_ref, -1, -2)
    Y = at_images(o, state, rows) @ R + state.t_cam_ref[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        r = (Y[..., :2] / Y[..., 2:] - o.x[rows]) * o.focal[rows][..., None]
    r[Y[..., 2] < NEAREST] = np.inf
    return r, state.used[rows] & np.isfinite(r).all(-1)


def errors_px(o: Observations, state: BundleState) -> FloatArray:
    """Reprojection errors (N, C, J), px; NaN where nothing was seen or no point is known.

    As precise as the image points are.
    """
    out = np.empty(o.seen.shape, o.x.dtype)
    for rows in _blocks(o):
        r = residuals_px(o, state, rows)[0]
        known = o.seen[rows] & (state.used[rows].sum(1) >= 2)[:, None]
        out[rows] = np.where(known, np.sqrt(r[..., 0] ** 2 + r[..., 1] ** 2), np.nan)
    return out


def _blocks(o: Observations) -> Iterator[slice]:
    """Rows in portions that fit into the cache."""
    N, C, J = o.seen.shape
    return row_blocks(N, C * J)


def median_error(errors: FloatArray, used: BoolArray) -> float:
    """Median of the used and finite errors (N, C, J), px; NaN if there is none."""
    chosen = errors[used & np.isfinite(errors)]
    return float(np.median(chosen, overwrite_input=True)) if len(chosen) else float("nan")


def robust_scale(errors: FloatArray, used: BoolArray) -> float:
    """Standard deviation (px, per axis) of the used observations (N, C, J), from their median.

    Every point takes three of the coordinates of its observations: what the residuals keep of
    the noise is smaller by that share.
    """
    known = used & np.isfinite(errors)
    if not known.any():
        return float("nan")
    share = 1.0 - 1.5 * float((known.sum(1) >= 2).sum()) / float(known.sum())
    sigma = median_error(errors, used) / RAYLEIGH_MEDIAN
    return sigma / float(np.sqrt(max(share, LEAST_SHARE)))


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
                V, A = motion(o, state.X, state.used.sum(1) >= 2)
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
) -> tuple[FloatArray, FloatArray]:
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
) -> tuple[FloatArray, FloatArray]:
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
) -> tuple[ReducedSystem, FloatArray]:
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
class Reduced:
    """The adjustment at one state: its robust cost, and the system with the points eliminated."""

    cost: float
    system: ReducedSystem
    eliminated: Sequence[Eliminated]


@dataclass(frozen=True, slots=True, eq=False)
class Moved:
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
        for rows in _blocks(self.o):
            yield Block(self.o, self.state.used, self.state.V, self.state.A, rows)

    def linearised(self) -> Iterator[tuple[Block, Linearisation]]:
        """The same with their predictions."""
        X = self.state.X.reshape(-1, 3)
        for block in self.blocks():
            yield block, block.at(self.cameras, X[block.points])

    def reduce(self, damping: float) -> Reduced:
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
        return Reduced(cost, ReducedSystem(H, g), eliminated)

    def moved(self, by: Reduced) -> Moved:
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
        return Moved(PointProblem(self.o, state, self.scale), cost, float(length))

    def state_of(self, before: BundleState) -> BundleState:
        """The state, the scale put back exactly to what it was before."""
        length = float(np.linalg.norm(before.t_cam_ref[1]))
        factor = length / float(np.linalg.norm(self.cameras.t[1]))
        scaled = {n: getattr(self.state, n) * factor for n in ("t_cam_ref", "X", "V", "A")}
        return replace(self.state, **scaled)


def gauge(t_cam_ref: FloatArray, *, synchronised: bool = False) -> tuple[IntArray, FloatArray]:
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
    system: ReducedSystem, t_cam_ref: FloatArray, *, synchronised: bool = False
) -> FloatArray:
    """Solution (C, 7) of the reduced system with the reference and the first baseline fixed."""
    free, scale = gauge(t_cam_ref, synchronised=synchronised)
    H = system.H + 1e6 * np.diag(system.H).max() * np.outer(scale, scale)
    H = H[np.ix_(free, free)]
    H[range(len(H)), range(len(H))] += 1e-12 * np.trace(H)
    out = np.zeros(len(system.g))
    out[free] = np.linalg.solve(H, system.g[free])
    return out.reshape(-1, CAMERA)
