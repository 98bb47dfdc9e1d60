"""The floor: how well a scene can be calibrated at all (Cramer-Rao bound).

Given true cameras and trajectories and who is seen when, with noise of Gauss on the image points.
Two models say what is known of the trajectories:

free points
    Every joint is anywhere at every moment; how it moves within half a frame is known. What the
    adjustment would reach if its velocities had no noise.
splines
    Every trajectory is a cubic B-spline with a knot per moment, and its accelerations are known to
    be about as large as they are (a prior of Gauss; the bound is that of van Trees). Velocities
    have to be estimated, and all that one camera sees alone counts as well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from stcalib_ros.core.bundle.covariance import information_covariance
from stcalib_ros.core.bundle.levenberg_marquardt import gauge
from stcalib_ros.core.bundle.normal_equations import CAMERA, Block, Cameras
from stcalib_ros.core.bundle.observations import Observations, row_blocks
from stcalib_ros.core.bundle.residuals import at_images
from stcalib_ros.core.bundle.state import BundleState
from stcalib_ros.core.geometry.bsplines import banded, basis, smoothness, summed, summed_squares
from stcalib_ros.core.model.arrays import BoolArray, Float64Array

Path = Callable[[Float64Array, int], Float64Array]
"""Joints (T, P, J, 3) in the reference frame at times (T,), or their n-th derivative by time."""

_RIDGE = 1e-12
_LEAST_ACCELERATION = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class TrueViews:
    """What is seen when, by whom, and how well.

    Attributes
    ----------
    R_cam_ref : (C, 3, 3) ndarray
    t_cam_ref : (C, 3) ndarray
        ``x_cam = R_cam_ref @ x_ref + t_cam_ref``; the first camera is the reference.
    focal_px : (C,) ndarray
        Pixels per unit of the plane z = 1.
    times_s : tuple of (T_c,) ndarray
        Of the images of every camera by the reference clock, increasing.
    seen : tuple of (T_c, P, J) ndarray of bool
    sigma_px : float
        Noise of an image point, per axis.
    """

    R_cam_ref: Float64Array
    t_cam_ref: Float64Array
    focal_px: Float64Array
    times_s: tuple[Float64Array, ...]
    seen: tuple[BoolArray, ...]
    sigma_px: float

    @property
    def start_s(self) -> float:
        """Time of the first image."""
        return min(float(t[0]) for t in self.times_s)

    @property
    def middle_s(self) -> float:
        """Middle of the recording: the moment that offsets hold for where rates are unknown."""
        return 0.5 * (self.start_s + max(float(t[-1]) for t in self.times_s))

    @property
    def step_s(self) -> float:
        """Between the knots: the median of the frame periods, the longer of two in the middle."""
        periods = sorted(float(np.median(np.diff(t))) for t in self.times_s)
        return periods[len(periods) // 2]


@dataclass(frozen=True, slots=True, eq=False)
class CramerRaoBound:
    """The bound of one scene.

    Attributes
    ----------
    covariance : (7 C, 7 C) ndarray
        With the first baseline as the unit of length: x, y, z of every camera's centre, rotation
        about the axes of the reference frame (rad) and offset (s). Pose and clock of the reference
        and the first baseline are fixed.
    rate_stddev : (C,) ndarray
        Of the clock rates; NaN where they count as known.
    """

    covariance: Float64Array
    rate_stddev: Float64Array


@dataclass(frozen=True, slots=True)
class ExpectedErrors:
    """Mean errors, as `metrics.Evaluation` measures them, of an estimate at the floor."""

    E_R: float
    E_t: float
    E_delta_s: float


def free_point_bound(views: TrueViews, path: Path, *, rates: bool = False) -> CramerRaoBound:
    """The bound where joints are anywhere at every moment.

    Parameters
    ----------
    views : Views
    path : callable
        True trajectories.
    rates : bool
        Clock rates are unknown as well.
    """
    o, state = true_problem(views, path)
    if not rates:
        return _floor(views, _reduced(o, state, np.ones(len(o.person)), views.sigma_px))
    since = np.asarray(o.knot * o.step_s, dtype=np.float64)
    middle = views.middle_s - views.start_s
    H_0, H_1, H_2 = (_reduced(o, state, since**n, views.sigma_px) for n in range(3))
    H_2 += middle * (middle * H_0 - 2.0 * H_1)
    H_1 -= middle * H_0
    offset = np.arange(CAMERA - 1, len(H_0), CAMERA)
    return _floor(views, np.block([[H_0, H_1[:, offset]], [H_1[offset], H_2[offset][:, offset]]]))


def spline_bound(views: TrueViews, path: Path, *, rates: bool = False) -> CramerRaoBound:
    """The bound where trajectories are splines; arguments as of `free_point_bound`.

    The accelerations of every joint are taken to have their true mean square.
    """
    H, W, band = _spline_equations(views, path)
    for w, lower in zip(W, band, strict=True):
        H -= w.T @ cho_solve_banded((cholesky_banded(lower, lower=True), True), w)
    n = len(H) if rates else CAMERA * len(views.times_s)
    return _floor(views, H[:n, :n])


def expected_errors(
    floor: CramerRaoBound, rng: np.random.Generator, *, n: int = 2000
) -> ExpectedErrors:
    """Mean errors of estimates that scatter by a floor.

    Parameters
    ----------
    floor : Floor
    rng : Generator
    n : int
        Estimates that are drawn.
    """
    free = floor.covariance[CAMERA:, CAMERA:]
    value, vector = np.linalg.eigh(free)
    drawn = rng.standard_normal((n, len(free))) * np.sqrt(np.maximum(value, 0.0)) @ vector.T
    e = drawn.reshape(n, -1, CAMERA)
    away = (e[..., :3] ** 2).sum(-1)
    return ExpectedErrors(
        float(np.linalg.norm(e[..., 3:6], axis=-1).mean()),
        float(np.sqrt(away.mean(-1)).mean()),
        float(np.abs(e[..., 6]).mean()),
    )


def true_problem(views: TrueViews, path: Path) -> tuple[Observations, BundleState]:
    """The adjustment of a scene at its optimum: image points without noise."""
    step = views.step_s
    C, P, J = len(views.seen), *views.seen[0].shape[1:]
    K = 1 + round((max(float(t[-1]) for t in views.times_s) - views.start_s) / step)
    phi, seen = np.zeros((K, C)), np.zeros((K, C, P, J), dtype=bool)
    for c, (times, mask) in enumerate(zip(views.times_s, views.seen, strict=True)):
        knot = np.rint((times - views.start_s) / step).astype(np.int64)
        late = times - views.start_s - knot * step
        order = np.argsort(-np.abs(late), kind="stable")
        phi[knot[order], c], seen[knot[order], c] = late[order], mask[order]
    seen &= (seen.sum(1) >= 2)[:, None]
    person, knot = (one.ravel() for one in np.indices((P, K)))
    moments = np.asarray(views.start_s + step * np.arange(K), dtype=np.float64)
    X, V, A = (path(moments, n) for n in range(3))
    X, V, A = (one.swapaxes(0, 1).reshape(P * K, J, 3) for one in (X, V, A))
    used = seen.transpose(2, 0, 1, 3).reshape(P * K, C, J)
    rows = used.any((1, 2))
    focal = np.broadcast_to(views.focal_px[:, None], used.shape).copy()
    o = Observations(
        person,
        knot,
        np.where(used.any(-1), person[:, None], -1),
        np.tile(phi, (P, 1)),
        np.zeros((*used.shape, 2)),
        focal,
        used,
        views.start_s,
        step,
    ).only(rows)
    state = BundleState(
        views.R_cam_ref, views.t_cam_ref, np.zeros(C), X[rows], V[rows], A[rows], used[rows]
    )
    Y = at_images(o, state) @ np.swapaxes(views.R_cam_ref, -1, -2) + views.t_cam_ref[:, None]
    x = np.where(o.seen[..., None], Y[..., :2] / Y[..., 2:], 0.0)
    return replace(o, x=x), state


def _reduced(
    o: Observations, state: BundleState, weight: Float64Array, sigma_px: float
) -> Float64Array:
    """Normal equations (7 C, 7 C) of the cameras with a weight (N,) of every moment.

    Points of one moment weigh alike, and therefore their share after elimination does.
    """
    weighted = replace(o, focal=o.focal * np.sqrt(weight)[:, None, None] / sigma_px)
    cameras = Cameras(state.R_cam_ref, state.t_cam_ref, state.shift_s)
    H = np.zeros((CAMERA * len(cameras.t),) * 2)
    X = state.X.reshape(-1, 3)
    N, C, J = o.seen.shape
    for rows in row_blocks(N, C * J):
        block = Block(weighted, state.used, state.V, state.A, rows)
        H += block.at(cameras, X[block.points]).reduce(np.inf, 0.0)[0].H
    return H


def _spline_equations(
    views: TrueViews, path: Path
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Normal equations of cameras, rates and spline coefficients.

    Returns
    -------
    H : (8 C, 8 C) ndarray
        Of poses and offsets of all cameras, then of all rates.
    W : (P J, 3 K, 8 C) ndarray
        Of the coefficients of every trajectory and the cameras.
    band : (P J, 12, 3 K) ndarray
        Lower diagonals of those of the coefficients.
    """
    C, P, J = len(views.seen), *views.seen[0].shape[1:]
    position = [(t - views.start_s) / views.step_s for t in views.times_s]
    K = 4 + max(int(p[-1]) for p in position)
    H = np.zeros((CAMERA + 1, C, CAMERA + 1, C))
    W = np.zeros((K, P * J, 3, CAMERA + 1, C))
    N = np.zeros((4, K, P * J, 3, 3))
    for c, at in enumerate(position):
        by_camera, by_joint = _derivatives(views, path, c)
        H[:, c, :, c] = np.einsum("tpra,tprb->ab", by_camera, by_camera, optimize=True)
        W[..., c] = summed(at, K, basis(at), by_joint.swapaxes(-1, -2) @ by_camera)
        N += summed_squares(at, K, by_joint.swapaxes(-1, -2) @ by_joint)
    N += _prior(views, path, K)
    N[0] += _RIDGE * np.trace(N[0], axis1=-2, axis2=-1).mean(0)[:, None, None] * np.eye(3)
    order = np.arange((CAMERA + 1) * C).reshape(CAMERA + 1, C)
    order = np.concatenate([order[:CAMERA].T.ravel(), order[CAMERA]])
    W = W.transpose(1, 0, 2, 3, 4).reshape(P * J, 3 * K, -1)
    return H.reshape(len(order), -1)[np.ix_(order, order)], W[..., order], banded(N)


def _derivatives(views: TrueViews, path: Path, c: int) -> tuple[Float64Array, Float64Array]:
    """Derivatives of image points, in units of the noise; zero where nothing is seen.

    By pose, offset and rate of the camera, (T, P J, 2, 8), and by the joint, (T, P J, 2, 3).
    """
    R, times = views.R_cam_ref[c], views.times_s[c]
    X, V = (path(times, n).reshape(len(times), -1, 3) for n in range(2))
    y, velocity = X @ R.T, V @ R.T
    seen = views.seen[c].reshape(y.shape[:2])
    z = y + views.t_cam_ref[c]
    gain = seen * views.focal_px[c] / views.sigma_px / np.where(seen, z[..., 2], 1.0)
    rows = np.zeros((*y.shape[:2], 2, 3))
    rows[..., 0, 0] = rows[..., 1, 1] = gain
    rows[..., 2] = -(gain / np.where(seen, z[..., 2], 1.0))[..., None] * z[..., :2]
    by_offset = np.einsum("tpri,tpi->tpr", rows, velocity)
    since = (times - views.middle_s)[:, None, None]
    columns = [np.cross(y[:, :, None], rows), rows, by_offset[..., None]]
    return np.concatenate([*columns, (since * by_offset)[..., None]], -1), rows @ R


def _prior(views: TrueViews, path: Path, K: int) -> Float64Array:
    """Normal equations (4, K, P J, 3, 3) of second differences, by the true accelerations."""
    knots = np.asarray(views.start_s + views.step_s * np.arange(K - 2), dtype=np.float64)
    A = path(knots, 2).reshape(K - 2, -1, 3)
    variance = np.maximum((A**2).mean((0, 2)), _LEAST_ACCELERATION**2) * views.step_s**4
    return smoothness(K, 1.0 / variance)


def _floor(views: TrueViews, H: Float64Array) -> CramerRaoBound:
    """The floor of normal equations of cameras (7 C, 7 C), or of cameras and rates (8 C, 8 C)."""
    C = len(views.seen)
    n = CAMERA * C
    nothing = np.zeros((0, 0, 3))
    state = BundleState(
        views.R_cam_ref, views.t_cam_ref, np.zeros(C), nothing, nothing, nothing, nothing > 0
    )
    stddev = np.full(C, np.nan)
    poses = H[:n, :n]
    if len(H) > n:
        rate = n + np.arange(1, C)
        mixed, own = H[:n, rate], H[np.ix_(rate, rate)]
        free, scale = gauge(views.t_cam_ref)
        fixed = poses + 1e6 * np.diag(poses).max() * np.outer(scale, scale)
        left = own - mixed[free].T @ np.linalg.solve(fixed[np.ix_(free, free)], mixed[free])
        stddev = np.concatenate([[0.0], np.sqrt(np.diag(np.linalg.inv(left)))])
        poses = poses - mixed @ np.linalg.solve(own, mixed.T)
    unit = np.ones((C, CAMERA))
    unit[:, :3] = np.linalg.norm(views.t_cam_ref[1])
    covariance = information_covariance(poses, state)
    return CramerRaoBound(covariance / np.outer(unit, unit), stddev)
