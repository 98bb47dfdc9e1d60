"""Spatiotemporal bundle adjustment (Section IV).

Minimises the robust reprojection error of ``X^c = X + (phi + d_c) V`` over camera poses,
clock offsets d_c and joint positions X, with the joint velocities V read from the present
trajectories; their curvature is added, so that only a change of acceleration within half a
frame is neglected. The points are eliminated (Schur complement), so that one step costs a batch
of closed-form 3x3 factorisations and one matrix product.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from stcalib_ros.core.averaging import Rig
from stcalib_ros.core.geometry import exp_so3, triangulate
from stcalib_ros.core.motion import local_cubic
from stcalib_ros.core.observations import Observations
from stcalib_ros.core.types import BoolArray, FloatArray, IntArray

_CAMERA = 7  # rotation, translation, offset
_CAUCHY = 2.385
_RAYLEIGH_MEDIAN = 1.17741
_MIN_SCALE_PX = 0.5
_LEAST_SHARE = 0.2
_NEAREST = 0.1
_MIN_RENEWALS = 8


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


@dataclass(frozen=True, slots=True, eq=False)
class ReducedSystem:
    """Normal equations of the cameras after the points are eliminated.

    Attributes
    ----------
    H : (7 C, 7 C) ndarray
        In the order rotation, translation, offset of each camera.
    g : (7 C,) ndarray
    """

    H: FloatArray
    g: FloatArray


def initial_state(o: Observations, rig: Rig) -> BundleState:
    """Triangulate everything with the poses of a rig and estimate the velocities.

    Done twice: the second time every ray starts where the motion since the knot puts it.
    """
    R_cam_ref = np.swapaxes(rig.R_ref_cam, -1, -2).copy()
    t_cam_ref = -np.einsum("cij,cj->ci", R_cam_ref, rig.t_ref_cam)
    rays = _rays(o, rig)
    weight = o.seen.transpose(0, 2, 1).astype(float)
    V, A = np.zeros((2, *weight.shape[:2], 3))
    when = o.phi[:, None, :, None]
    for _ in range(2):
        centres = rig.t_ref_cam - when * (V[:, :, None] + 0.5 * when * A[:, :, None])
        X, good = triangulate(centres, rays, weight, refinements=1)
        X = np.where(good[..., None], X, 0.0)
        V, A = motion(o, X, good)
    shift_s, used = np.zeros(len(R_cam_ref)), o.seen & good[:, None, :]
    return BundleState(R_cam_ref, t_cam_ref, shift_s, X, V, A, used, rig.synchronised)


def _rays(o: Observations, rig: Rig) -> FloatArray:
    """Unit rays (N, J, C, 3) of all observations in the reference frame."""
    b = np.concatenate([o.x, np.ones_like(o.x[..., :1])], -1)
    b /= np.linalg.norm(b, axis=-1, keepdims=True)
    turned = b @ np.swapaxes(rig.R_ref_cam, -1, -2)
    return np.asarray(turned.transpose(0, 2, 1, 3))


def motion(
    o: Observations, X: FloatArray, present: BoolArray, *, half_window: int = 3
) -> tuple[FloatArray, FloatArray]:
    """Velocities and accelerations (N, J, 3) by a local cubic fit along each person's knots."""
    V, A = np.zeros((2, *X.shape))
    for rows in persons_of(o):
        knots = o.knot[rows] - o.knot[rows][0]
        n = int(knots[-1]) + 1
        path, there = np.zeros((n, *X.shape[1:])), np.zeros((n, X.shape[1]), dtype=bool)
        path[knots], there[knots] = X[rows], present[rows]
        per_step, per_step2 = local_cubic(path, there, half_window=half_window)
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
    when = (o.phi[rows] + state.shift_s)[..., None, None]
    V, A = state.V[rows][:, None], state.A[rows][:, None]
    return np.asarray(state.X[rows][:, None] + when * (V + 0.5 * when * A))


def residuals_px(o: Observations, state: BundleState) -> tuple[FloatArray, BoolArray]:
    """Reprojection residuals (N, C, J, 2), px, and which of them take part and are finite."""
    R = np.swapaxes(state.R_cam_ref, -1, -2)
    Y = at_images(o, state) @ R + state.t_cam_ref[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        r = (Y[..., :2] / Y[..., 2:] - o.x) * o.focal[..., None]
    r[Y[..., 2] < _NEAREST] = np.inf
    return r, state.used & np.isfinite(r).all(-1)


def errors_px(o: Observations, state: BundleState) -> FloatArray:
    """Reprojection errors (N, C, J), px; NaN where nothing was seen or no point is known."""
    e = np.linalg.norm(residuals_px(o, state)[0], axis=-1)
    return np.where(o.seen & (state.used.sum(1) >= 2)[:, None], e, np.nan)


def robust_scale(errors: FloatArray, used: BoolArray) -> float:
    """Standard deviation (px, per axis) of the used observations (N, C, J), from their median.

    Every point takes three of the coordinates of its observations: what the residuals keep of
    the noise is smaller by that share.
    """
    known = used & np.isfinite(errors)
    if not known.any():
        return float("nan")
    share = 1.0 - 1.5 * float((known.sum(1) >= 2).sum()) / float(known.sum())
    sigma = float(np.median(errors[known])) / _RAYLEIGH_MEDIAN
    return sigma / float(np.sqrt(max(share, _LEAST_SHARE)))


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
    scale = _CAUCHY * max(robust_scale(errors_px(o, state), state.used), _MIN_SCALE_PX)
    problem = _Problem(o, state, scale)
    least = _MIN_RENEWALS if renew_velocities else 0
    for step in range(iterations):
        trial, length = problem.step(damping)
        if trial.cost() < problem.cost():
            problem = trial
            damping = max(damping / 10.0, 1e-9)
            if renew_velocities:
                state = problem.state_of(state)
                V, A = motion(o, state.X, state.used.sum(1) >= 2)
                state = replace(state, V=V, A=A)
                problem = _Problem(o, state, scale)
            if length < tolerance and step >= least:
                break
        else:
            damping *= 10.0
            if damping > 1e4:
                break
    return problem.state_of(state)


def point_scores(o: Observations, state: BundleState) -> tuple[ReducedSystem, FloatArray, IntArray]:
    """Undamped reduced normal equations at a state, and what each point adds to their gradient.

    Returns
    -------
    system : ReducedSystem
    scores : (7 C, P) ndarray
        Their sum is ``system.g``.
    points : (P,) ndarray of int
        Row and joint of each point, as ``row * J + joint``.
    """
    sigma = max(robust_scale(errors_px(o, state), state.used), _MIN_SCALE_PX)
    problem = _Problem(o, state, _CAUCHY * sigma)
    reduction = problem.reduce(0.0)
    return reduction.system, problem.scores(reduction), problem.points


@dataclass(frozen=True, slots=True, eq=False)
class _Reduction:
    """Reduced system and what the points need to follow: L, T = L^-1 W^T (3, 7 C, P), L^-1 g."""

    system: ReducedSystem
    factors: tuple[FloatArray, ...]
    T: FloatArray
    z: FloatArray


class _Problem:
    """One linearisation: arrays over (camera, component, point), points last and contiguous."""

    def __init__(self, o: Observations, state: BundleState, scale: float) -> None:
        self.o, self.scale = o, scale
        N, C, J = o.seen.shape
        use = state.used.transpose(1, 0, 2).reshape(C, N * J)
        self.points = np.flatnonzero(use.sum(0) >= 2)
        self.mask = use[:, self.points]
        self.x = o.x.transpose(1, 3, 0, 2).reshape(C, 2, N * J)[:, :, self.points]
        self.focal = o.focal.transpose(1, 0, 2).reshape(C, N * J)[:, self.points] * self.mask
        self.phi = np.repeat(o.phi.T, J, axis=1)[:, self.points]
        self.R, self.t, self.shift = state.R_cam_ref, state.t_cam_ref, state.shift_s
        self.synchronised = state.synchronised
        self.X = state.X.reshape(-1, 3)[self.points].T
        self.V = state.V.reshape(-1, 3)[self.points].T
        self.A = state.A.reshape(-1, 3)[self.points].T
        self._forward()

    def _forward(self) -> None:
        when = (self.phi + self.shift[:, None])[:, None]
        half = when * (0.5 * self.R @ self.A)
        self.RV = self.R @ self.V + half
        self.Y = self.R @ self.X + when * self.RV
        self.RV += half
        Z = self.Y + self.t[:, :, None]
        self.ahead = Z[:, 2] > _NEAREST
        self.inverse_depth = 1.0 / np.where(self.ahead, Z[:, 2], 1.0)
        self.u = Z[:, :2] * self.inverse_depth[:, None]
        self.r = (self.u - self.x) * self.focal[:, None]
        self.squared = (self.r**2).sum(1)

    def cost(self) -> float:
        """Robust cost; a point behind its camera counts as far off."""
        squared = np.where(self.ahead, self.squared, (1e3 * self.scale) ** 2 * self.mask)
        return float(np.log1p(squared / self.scale**2).sum())

    def _jacobians(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Weighted J_camera (C, 7, 2, P), J_point (C, 3, 2, P) and residual (C, 2, P)."""
        root = np.sqrt(self.mask * self.ahead / (1.0 + self.squared / self.scale**2))
        A = np.zeros((*self.u.shape[:2], 3, self.u.shape[2]))
        gain = root * self.focal * self.inverse_depth
        A[:, 0, 0] = A[:, 1, 1] = gain
        A[:, :, 2] = -gain[:, None] * self.u
        C, P = root.shape
        G = np.empty((C, _CAMERA, 2, P))
        Y, RV = self.Y, self.RV
        for i in range(2):
            G[:, 0, i] = Y[:, 1] * A[:, i, 2] - Y[:, 2] * A[:, i, 1]
            G[:, 1, i] = Y[:, 2] * A[:, i, 0] - Y[:, 0] * A[:, i, 2]
            G[:, 2, i] = Y[:, 0] * A[:, i, 1] - Y[:, 1] * A[:, i, 0]
            G[:, 3:6, i] = A[:, i]
            G[:, 6, i] = (A[:, i] * RV).sum(1)
        B = np.swapaxes(np.swapaxes(self.R, -1, -2)[:, None] @ A, 1, 2)
        B = np.ascontiguousarray(B)
        return G, B, self.r * root[:, None]

    def reduce(self, damping: float) -> _Reduction:
        """Eliminate the points."""
        G, B, r = self._jacobians()
        C, _, _, P = G.shape
        flat = G.reshape(C, _CAMERA, 2 * P)
        H_cc = flat @ flat.transpose(0, 2, 1)
        g_c = (flat @ r.reshape(C, 2 * P, 1))[..., 0]
        W = np.empty((3, C, _CAMERA, P))
        for k in range(3):
            np.multiply(G[:, :, 0], B[:, None, k, 0], out=W[k])
            W[k] += G[:, :, 1] * B[:, None, k, 1]
        H_pp = np.einsum("caip,cbip->abp", B, B, optimize=True)
        factors = _cholesky3(H_pp, damping)
        T = _forward_solve(factors, W).reshape(3, C * _CAMERA, P)
        z = _forward_solve(factors, np.einsum("cbip,cip->bp", B, r))
        H = -np.sum(T @ T.transpose(0, 2, 1), axis=0)
        for c in range(C):
            block = slice(c * _CAMERA, (c + 1) * _CAMERA)
            H[block, block] += H_cc[c] + damping * np.diag(np.diag(H_cc[c]))
        system = ReducedSystem(H, g_c.ravel() - np.einsum("kap,kp->a", T, z))
        return _Reduction(system, factors, T, z)

    def scores(self, reduction: _Reduction) -> FloatArray:
        """Reduced gradients (7 C, P) of the single points."""
        G, _, r = self._jacobians()
        direct = G[:, :, 0] * r[:, None, 0] + G[:, :, 1] * r[:, None, 1]
        flat: FloatArray = direct.reshape(-1, r.shape[-1])
        return np.asarray(flat - np.einsum("kap,kp->ap", reduction.T, reduction.z))

    def step(self, damping: float) -> tuple[_Problem, float]:
        """The problem after one damped step, and how many standard deviations the cameras moved.

        The reference pose and the scale stay.
        """
        reduction = self.reduce(damping)
        d_camera = -solve_reduced(reduction.system, self.t, synchronised=self.synchronised)
        flat = d_camera.ravel()
        length = np.sqrt(max(float(flat @ reduction.system.H @ flat), 0.0)) * _CAUCHY / self.scale
        d_point = -_backward_solve(reduction.factors, reduction.z + flat @ reduction.T)
        trial = object.__new__(_Problem)
        trial.__dict__.update(self.__dict__)
        trial.R = exp_so3(d_camera[:, :3]) @ self.R
        trial.t = self.t + d_camera[:, 3:6]
        trial.shift = self.shift + d_camera[:, 6]
        trial.X = self.X + d_point
        trial._forward()
        return trial, float(length)

    def state_of(self, state: BundleState) -> BundleState:
        """A state with the unknowns of this problem, the scale put back exactly."""
        scale = float(np.linalg.norm(state.t_cam_ref[1]) / np.linalg.norm(self.t[1]))
        X = state.X.copy()
        X.reshape(-1, 3)[self.points] = self.X.T
        return replace(
            state,
            R_cam_ref=self.R,
            t_cam_ref=self.t * scale,
            shift_s=self.shift,
            X=X * scale,
            V=state.V * scale,
            A=state.A * scale,
        )


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
    scale = np.zeros(_CAMERA * C)
    scale[_CAMERA + 3 : _CAMERA + 6] = t_cam_ref[1] / np.linalg.norm(t_cam_ref[1])
    free = np.arange(_CAMERA, _CAMERA * C, dtype=np.int64)
    return free[free % _CAMERA != _CAMERA - 1] if synchronised else free, scale


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
    return out.reshape(-1, _CAMERA)


def _cholesky3(H: FloatArray, damping: float) -> tuple[FloatArray, ...]:
    """Cholesky factors (l00, l10, l11, l20, l21, l22), each (P,), of matrices (3, 3, P)."""
    tiny = 1e-12 * (H[0, 0] + H[1, 1] + H[2, 2]) + 1e-30
    grow = 1.0 + damping
    l00 = np.sqrt(H[0, 0] * grow + tiny)
    l10, l20 = H[1, 0] / l00, H[2, 0] / l00
    l11 = np.sqrt(np.maximum(H[1, 1] * grow + tiny - l10**2, tiny))
    l21 = (H[2, 1] - l20 * l10) / l11
    l22 = np.sqrt(np.maximum(H[2, 2] * grow + tiny - l20**2 - l21**2, tiny))
    return l00, l10, l11, l20, l21, l22


def _forward_solve(factors: tuple[FloatArray, ...], b: FloatArray) -> FloatArray:
    """``L y = b`` for b (3, ..., P), in place."""
    l00, l10, l11, l20, l21, l22 = factors
    b[0] /= l00
    b[1] -= l10 * b[0]
    b[1] /= l11
    b[2] -= l20 * b[0]
    b[2] -= l21 * b[1]
    b[2] /= l22
    return b


def _backward_solve(factors: tuple[FloatArray, ...], y: FloatArray) -> FloatArray:
    """``L^T x = y`` for y (3, P)."""
    l00, l10, l11, l20, l21, l22 = factors
    x = np.empty_like(y)
    x[2] = y[2] / l22
    x[1] = (y[1] - l21 * x[2]) / l11
    x[0] = (y[0] - l10 * x[1] - l20 * x[2]) / l00
    return x
