"""Cramer-Rao lower bound: how well a scene can be calibrated at all.

Given true cameras and trajectories and who is seen when, with Gaussian noise on the keypoints.
Two models say what is known of the trajectories:

free points
    Every joint is anywhere at every moment; how it moves within half a frame is known. What the
    adjustment would reach if its velocities had no noise.
splines
    Every trajectory is a cubic B-spline with a time bin per time bin, and its accelerations have a
    Gaussian prior of their true mean square; the bound is that of van Trees. Velocities have to be
    estimated, and what only one camera observes counts as well.

References
----------
H. L. van Trees, "Detection, Estimation, and Modulation Theory, Part I", Wiley, 1968, section 2.4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from stcalib_ros.core.bundle.covariance import JointCovariance, publication, with_known_distance
from stcalib_ros.core.bundle.gauge import camera_centres
from stcalib_ros.core.bundle.lens_unknowns import layout_of
from stcalib_ros.core.bundle.lenses import FOCAL, N_CORRECTIONS, RADIAL, Lenses
from stcalib_ros.core.bundle.levenberg_marquardt import PointProblem
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.parameters import (
    CLOCK_SKEW,
    ROTATION,
    TIME_OFFSET,
    TRANSLATION,
    Cameras,
    ParameterLayout,
)
from stcalib_ros.core.bundle.point_views import PointTimes
from stcalib_ros.core.bundle.residuals import Projection, camera_points
from stcalib_ros.core.bundle.state import BundleState
from stcalib_ros.core.geometry.bsplines import banded, basis, smoothness, summed, summed_squares
from stcalib_ros.core.model.arrays import BoolArray, Float64Array

Path = Callable[[Float64Array, int], Float64Array]
"""Joints (T, P, J, 3) in the reference frame at times (T,), or their n-th derivative by time."""

_RIDGE = 1e-12
"""Fraction of the mean diagonal of the normal equations of the splines. Numerical."""
_LEAST_ACCELERATION = 1e-3
"""Fraction of the largest mean square acceleration of a joint: joints that hardly move still have
a finite prior. Numerical."""

_HALF_NORMAL = float(np.sqrt(2.0 / np.pi))
"""Mean size of an error over its standard deviation, if it has a Gaussian distribution."""


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
    lenses : Lenses or None
        True lenses; those of their corrections that are free are unknowns, with what is known of
        them. Default: pinhole lenses that are known.
    """

    R_cam_ref: Float64Array
    t_cam_ref: Float64Array
    focal_px: Float64Array
    times_s: tuple[Float64Array, ...]
    observed: tuple[BoolArray, ...]
    sigma_px: float
    lenses: Lenses | None = None

    @property
    def centres(self) -> Float64Array:
        """Centres (C, 3) of the cameras."""
        return camera_centres(self.R_cam_ref, self.t_cam_ref)

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
        """Length of a time bin: the median of the frame periods, the longer of the middle two."""
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
    lens_stddev : (5, C) ndarray
        Of the corrections of the lenses; NaN where they count as known.
    """

    covariance: Float64Array
    rate_stddev: Float64Array
    lens_stddev: Float64Array


@dataclass(frozen=True, slots=True)
class ExpectedErrors:
    """Mean errors, as `metrics.Evaluation` measures them, of an estimate at the floor."""

    E_R: float
    E_t: float
    E_delta_s: float
    E_f: float
    E_k1: float


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
    obs, state = true_problem(views, path)
    layout = _layout(views, rates=rates)
    weighted = replace(obs, focal=obs.focal / views.sigma_px)
    problem = PointProblem(weighted, state, np.inf, layout)
    H = np.diag(layout.prior(state.cameras)[0])
    for _, at in problem.linearised():
        H += at.reduce(problem.scale, 0.0)[0].H
    return _bound(views, H, layout)


def _layout(views: TrueViews, *, rates: bool) -> ParameterLayout:
    C = len(views.times_s)
    layout = layout_of(C, views.lenses, synchronised=False)
    return layout.with_unknown(CLOCK_SKEW, np.full(C, rates))


def spline_bound(views: TrueViews, path: Path, *, rates: bool = False) -> CramerRaoBound:
    """The bound where trajectories are splines; arguments as of `free_point_bound`.

    The accelerations of every joint are taken to have their true mean square.
    """
    layout = _layout(views, rates=rates)
    H, W, band = _spline_equations(views, path, layout)
    for w, lower in zip(W, band, strict=True):
        H -= w.T @ cho_solve_banded((cholesky_banded(lower, lower=True), True), w)
    return _bound(views, H, layout)


def expected_errors(
    floor: CramerRaoBound, rng: np.random.Generator, *, n: int = 2000
) -> ExpectedErrors:
    """Mean errors of estimates that scatter by a floor.

    Parameters
    ----------
    floor : Floor
    rng : Generator
    n : int
        Number of samples.
    """
    C = floor.covariance.shape[0] // ParameterLayout(1).size
    published = ParameterLayout(C)
    free = published.free()
    value, vector = np.linalg.eigh(floor.covariance[np.ix_(free, free)])
    sample = rng.standard_normal((n, len(free))) * np.sqrt(np.maximum(value, 0.0)) @ vector.T
    e = sample.reshape(n, C - 1, published.block)
    # Centres are published first: in the rows of the rotations.
    centre, turn, offset = (
        e[..., published.within(one)] for one in (ROTATION, TRANSLATION, TIME_OFFSET)
    )
    return ExpectedErrors(
        float(np.linalg.norm(turn, axis=-1).mean()),
        float(np.sqrt((centre**2).sum(-1).mean(-1)).mean()),
        float(np.abs(offset).mean()),
        *(float(_HALF_NORMAL * np.mean(floor.lens_stddev[row])) for row in (FOCAL, RADIAL)),
    )


def true_problem(views: TrueViews, path: Path) -> tuple[Observations, BundleState]:
    """The adjustment of a scene at its optimum: image points without noise."""
    step = views.step_s
    C, P, J = len(views.observed), *views.observed[0].shape[1:]
    K = 1 + round((max(float(t[-1]) for t in views.times_s) - views.start_s) / step)
    phi, seen = np.zeros((K, C)), np.zeros((K, C, P, J), dtype=bool)
    for c, (times, mask) in enumerate(zip(views.times_s, views.observed, strict=True)):
        time_bin = np.rint((times - views.start_s) / step).astype(np.int64)
        late = times - views.start_s - time_bin * step
        order = np.argsort(-np.abs(late), kind="stable")
        phi[time_bin[order], c], seen[time_bin[order], c] = late[order], mask[order]
    seen &= (seen.sum(1) >= 2)[:, None]
    person, time_bin = (one.ravel() for one in np.indices((P, K)))
    moments = np.asarray(views.start_s + step * np.arange(K), dtype=np.float64)
    X, V, A = (path(moments, n) for n in range(3))
    X, V, A = (one.swapaxes(0, 1).reshape(P * K, J, 3) for one in (X, V, A))
    used = seen.transpose(2, 0, 1, 3).reshape(P * K, C, J)
    rows = used.any((1, 2))
    obs = Observations(
        person,
        time_bin,
        np.where(used.any(-1), person[:, None], -1),
        np.tile(phi, (P, 1)),
        np.zeros((*used.shape, 2)),
        np.ones(used.shape),
        used,
        views.start_s,
        step,
        middle_s=views.middle_s,
        lenses=views.lenses,
    ).only(rows)
    state = BundleState(
        *(views.R_cam_ref, views.t_cam_ref, np.zeros(C), X[rows], V[rows], A[rows], used[rows]),
        lenses=views.lenses,
    )
    Y = camera_points(obs, state)
    x = np.where(obs.observed[..., None], Y[..., :2] / Y[..., 2:], 0.0)
    focal = np.where(obs.observed, _pixels_per_unit(views, x), 1.0)
    return replace(obs, x=x, focal=focal), state


def _pixels_per_unit(views: TrueViews, x: Float64Array) -> Float64Array:
    """Pixels per unit (..., C, P) of the plane z = 1 at points x (..., C, P, 2)."""
    focal = np.broadcast_to(views.focal_px[:, None], x.shape[:-1])
    if views.lenses is None:
        return focal
    at = views.lenses.profile.at(np.linalg.norm(x, axis=-1))
    return np.asarray(focal * np.sqrt(at.gain * at.slope))


def _spline_equations(
    views: TrueViews, path: Path, layout: ParameterLayout
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Normal equations of the unknowns of the cameras and of spline coefficients.

    Returns
    -------
    H : (n, n) ndarray
    W : (P J, 3 K, n) ndarray
        Of the coefficients of every trajectory and the cameras.
    band : (P J, 12, 3 K) ndarray
        Lower diagonals of those of the coefficients.
    """
    P, J = views.observed[0].shape[1:]
    position = [(t - views.start_s) / views.step_s for t in views.times_s]
    K = 4 + max(int(p[-1]) for p in position)
    H = np.diag(layout.prior(_cameras(views))[0])
    W = np.zeros((K, P * J, 3, layout.size))
    N = np.zeros((4, K, P * J, 3, 3))
    for c, at in enumerate(position):
        by_camera, by_joint = _derivatives(views, path, c, layout)
        own = layout.of_camera(c)
        H[own, own] += np.einsum("tpra,tprb->ab", by_camera, by_camera, optimize=True)
        W[..., own] = summed(at, K, basis(at), by_joint.swapaxes(-1, -2) @ by_camera)
        N += summed_squares(at, K, by_joint.swapaxes(-1, -2) @ by_joint)
    N += _prior(views, path, K)
    N[0] += _RIDGE * np.trace(N[0], axis1=-2, axis2=-1).mean(0)[:, None, None] * np.eye(3)
    return H, W.transpose(1, 0, 2, 3).reshape(P * J, 3 * K, -1), banded(N)


def _derivatives(
    views: TrueViews, path: Path, c: int, layout: ParameterLayout
) -> tuple[Float64Array, Float64Array]:
    """Derivatives of keypoints, in units of the noise; zero where nothing is observed.

    By the unknowns of the camera, (T, P J, 2, n), and by the joint, (T, P J, 2, 3).
    """
    R, times = views.R_cam_ref[c], views.times_s[c]
    X, V = (path(times, n).reshape(-1, 3) for n in range(2))
    T, m = len(times), len(X) // len(times)
    camera = _cameras(views).only(c)
    since = np.repeat(times - views.middle_s, m)[None]
    Y = X @ R.T + views.t_cam_ref[c]
    own = replace(
        views,
        focal_px=views.focal_px[c : c + 1],
        lenses=None if views.lenses is None else views.lenses.only(c),
    )
    focal = _pixels_per_unit(own, (Y[:, :2] / Y[:, 2:])[None])
    focal = views.observed[c].reshape(1, -1) * focal / views.sigma_px
    at = Projection(
        camera,
        (R @ X.T)[None],
        (R @ V.T)[None],
        PointTimes(since, np.zeros((1, 1))),
        np.zeros((1, 2, T * m)),
        focal,
    )
    A, _ = at.rows(np.inf)
    columns = at.camera_columns(A, layout)[0].transpose(2, 1, 0).reshape(T, m, 2, -1)
    return columns, at.point_columns(A)[0].transpose(2, 0, 1).reshape(T, m, 2, 3)


def _prior(views: TrueViews, path: Path, K: int) -> Float64Array:
    """Normal equations (4, K, P J, 3, 3) of second differences, by the true accelerations."""
    time_bins = np.asarray(views.start_s + views.step_s * np.arange(K - 2), dtype=np.float64)
    A = path(time_bins, 2).reshape(K - 2, -1, 3)
    variance = np.maximum((A**2).mean((0, 2)), _LEAST_ACCELERATION**2) * views.step_s**4
    return smoothness(K, 1.0 / variance)


def _bound(views: TrueViews, H: Float64Array, layout: ParameterLayout) -> CramerRaoBound:
    """The bound of normal equations of the unknowns of a layout."""
    C, cameras = layout.n_cameras, _cameras(views)
    P = layout.inverse(H, cameras)
    names = tuple(str(c) for c in range(C))
    joint = JointCovariance(names, layout, P, publication(cameras, layout))
    stddev = np.full(C, np.nan)
    if CLOCK_SKEW in layout.further:
        rate = layout.scalars(CLOCK_SKEW)
        stddev = np.sqrt(P[rate, rate])
    lens_stddev = np.full((N_CORRECTIONS, C), np.nan)
    for unknown in layout.further:
        if unknown.row is not None:
            own = layout.scalars(unknown)
            lens_stddev[unknown.row] = np.sqrt(P[own, own])
    covariance = with_known_distance(joint.poses_and_offsets(), views.centres, 0, 1)
    lengths = np.repeat([np.linalg.norm(views.centres[1]), 1.0], [3, 4])
    unit = np.tile(lengths, C)
    return CramerRaoBound(covariance / np.outer(unit, unit), stddev, lens_stddev)


def _cameras(views: TrueViews) -> Cameras:
    C = len(views.t_cam_ref)
    return Cameras(views.R_cam_ref, views.t_cam_ref, np.zeros(C), lenses=views.lenses)
