"""Resection of a camera of a rig with its lens free, from people that the other cameras see.

With a lens that is not that of its images, a camera finds a pose that makes up for most of it, and
bends the poses of the others a little. The people that the others triangulate without it are nearly
right nevertheless: against them, focal lengths, principal point and radial distortion show.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.covariance import clusters
from stcalib_ros.core.bundle.limits import NEAREST
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.state import BundleState
from stcalib_ros.core.geometry.robust import CAUCHY, MIN_SCALE_PX, RAYLEIGH_MEDIAN
from stcalib_ros.core.geometry.so3 import exp_so3, hat
from stcalib_ros.core.geometry.triangulation import triangulate, unit_rays
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.reconstruction.projective import decomposed_projection, linear_projection

LENS = ("focal", "aspect", "x", "y", "radial")
"""Unknowns of a lens, relative to the one given: logarithms of the focal length and of the square
root of fx / fy, principal point on the plane z = 1, coefficient of radial distortion."""

_POSE = 7
"""Unknowns before those of the lens: rotation, translation, time. By definition."""
_MAX_POINTS = 1500
"""Count. Of more keypoints of a camera a regular part is used. Cost alone: a focal length is
determined by a tenth of it."""
_MIN_POINTS = 200
"""Count. With fewer keypoints nothing is said: twelve images of one person. Chosen."""
_STEPS = 25
"""Steps of one fit at most. Numerical: usually four, thirty from far away."""
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING, _DAMPING_FACTOR = 1e-4, 1e-9, 1e3, 10.0
"""Fractions of the diagonal, and their ratio from step to step. Numerical."""
_MIN_DECREASE = 1e-4
"""Fraction of the cost. A step that gains less ends the fit. Numerical."""
_WIDEST = 4.0
"""Square of the tangent of the angle off the axis up to which radial distortion grows: beyond, the
term of one coefficient says nothing. Chosen: 127 degrees, as `WIDEST_VIEW`."""


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """Keypoints of one camera, and where the other cameras see these joints.

    Attributes
    ----------
    X, V : (N, 3) ndarray
        Joints at the time of the image and their velocities, in the frame of the reference camera.
    x : (N, 2) ndarray
        Keypoints on the plane z = 1.
    focal : (N,) ndarray
        Pixels per unit of x.
    cluster : (N,) ndarray of int
        Keypoints with one number are not independent.
    """

    X: Float64Array
    V: Float64Array
    x: Float64Array
    focal: Float64Array
    cluster: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class LensFit:
    """Pose, time and lens of a camera by resection.

    Attributes
    ----------
    R_cam_ref : (3, 3) ndarray
    t_cam_ref : (3,) ndarray
    late_s : float
        Correction of its time offset, seconds.
    lens : (5,) ndarray
        Values of `LENS`; 0: as given.
    stddev : (5,) ndarray
        Their standard deviations; infinite of what is not free.
    median_px : float
        Median error of the keypoints.
    """

    R_cam_ref: Float64Array
    t_cam_ref: Float64Array
    late_s: float
    lens: Float64Array
    stddev: Float64Array
    median_px: float = np.inf


def as_given(R_cam_ref: Float64Array, t_cam_ref: Float64Array) -> LensFit:
    """Return a camera at a pose with the lens that it was given, to start from."""
    return LensFit(R_cam_ref, t_cam_ref, 0.0, np.zeros(len(LENS)), np.full(len(LENS), np.inf))


def sighting(obs: Observations, state: BundleState, c: int) -> Sighting | None:
    """Return what a camera (its position in the rig) sees of joints that two others triangulate.

    None where that is too little.
    """
    used = state.inlier.copy()
    used[:, c] = False
    seen = obs.observed[:, c] & (used.sum(1) >= 2)
    rows = np.flatnonzero(seen.any(1))[:: max(1, int(seen.sum()) // _MAX_POINTS)]
    if not len(rows):
        return None
    delay = obs.elapsed(rows) + state.cameras.delay(obs.point_times(rows))
    when = np.broadcast_to(delay, used[rows].shape).transpose(0, 2, 1)[..., None]
    moved = when * (state.V[rows, :, None] + 0.5 * when * state.A[rows, :, None])
    rays = unit_rays(obs.x[rows].astype(np.float64)) @ state.R_cam_ref
    weight = used[rows].transpose(0, 2, 1).astype(np.float64)
    centre = -np.einsum("cji,cj->ci", state.R_cam_ref, state.t_cam_ref)
    X, good = triangulate(centre - moved, rays.transpose(0, 2, 1, 3), weight, refinements=1)
    known = good & seen[rows]
    if known.sum() < _MIN_POINTS:
        return None
    number = clusters(obs.only(rows), known, n_unknowns=_POSE + len(LENS))
    return Sighting(
        (X + moved[:, :, c])[known],
        state.V[rows][known],
        obs.x[rows, c][known].astype(np.float64),
        obs.focal[rows, c][known].astype(np.float64),
        number[known],
    )


def fit_lens(points: Sighting, start: LensFit, *, radial: bool) -> LensFit:
    """Fit pose, time and lens of a camera to what it sees, by Levenberg-Marquardt.

    Parameters
    ----------
    points : Sighting
    start : LensFit
    radial : bool
        Radial distortion is free, too.
    """
    n = _POSE + len(LENS) - (not radial)
    view, damping = _View(points, start), _FIRST_DAMPING
    scale = view.scale()
    for _ in range(_STEPS):
        H, g, _, _ = _normal_equations(view, scale, n)
        before = view.cost(scale)
        while damping <= _MOST_DAMPING:
            step = np.asarray(-np.linalg.solve(H + damping * np.diag(np.diag(H)), g), np.float64)
            there = _View(points, _stepped(view.at, step))
            if there.cost(scale) < before:
                break
            damping *= _DAMPING_FACTOR
        else:
            break
        gained = before - there.cost(scale)
        view, damping = there, max(damping / _DAMPING_FACTOR, _LEAST_DAMPING)
        scale = view.scale()
        if gained < _MIN_DECREASE * before:
            break
    return _with_errors(view, scale, n)


def start_from_projection(points: Sighting) -> LensFit | None:
    """Return a start by a projection matrix, however far it is; None where there is none."""
    found = decomposed_projection(linear_projection(points.X, points.x))
    if found is None:
        return None
    K, R, t = found
    fx, fy = np.log(K[0, 0]), np.log(K[1, 1])
    lens = np.array([0.5 * (fx + fy), 0.5 * (fx - fy), K[0, 2], K[1, 2], 0.0])
    return replace(as_given(R, t), lens=lens)


class _View:
    """Keypoints as a fit predicts them, with residuals in px."""

    def __init__(self, points: Sighting, at: LensFit) -> None:
        self.points, self.at = points, at
        self.y = (points.X + at.late_s * points.V) @ at.R_cam_ref.T
        Z = self.y + at.t_cam_ref
        self.depth = np.maximum(Z[:, 2], NEAREST)
        self.u = Z[:, :2] / self.depth[:, None]
        self.square = np.minimum((self.u**2).sum(1), _WIDEST)
        self.gain = np.exp(at.lens[0] + at.lens[1] * np.array([1.0, -1.0]))
        self.bent = self.gain * self.u * (1.0 + at.lens[4] * self.square)[:, None]
        self.r = (self.bent + at.lens[2:4] - points.x) * points.focal[:, None]
        self.squared = (self.r**2).sum(1)

    def cost(self, scale: float) -> float:
        """Robust cost."""
        return float(np.log1p(self.squared / scale**2).sum())

    def scale(self) -> float:
        """Scale of the robust loss, px, by the median error."""
        sigma = float(np.sqrt(np.median(self.squared))) / RAYLEIGH_MEDIAN
        return CAUCHY * max(sigma, MIN_SCALE_PX)

    def jacobian(self) -> Float64Array:
        """Derivatives (N, 2, 12) of the residuals by pose, time and lens."""
        n, radial = len(self.u), self.at.lens[4]
        by_point = np.zeros((n, 2, 3))
        by_point[:, 0, 0] = by_point[:, 1, 1] = 1.0 / self.depth
        by_point[:, :, 2] = -self.u / self.depth[:, None]
        by_plane = (1.0 + radial * self.square)[:, None, None] * np.eye(2)
        by_plane = by_plane + 2.0 * radial * self.u[:, :, None] * self.u[:, None]
        A = self.gain[:, None] * (by_plane @ by_point)
        velocity = self.points.V @ self.at.R_cam_ref.T
        lens = np.zeros((n, 2, len(LENS)))
        lens[:, :, 0] = self.bent
        lens[:, :, 1] = self.bent * [1.0, -1.0]
        lens[:, 0, 2] = lens[:, 1, 3] = 1.0
        lens[:, :, 4] = self.gain * self.u * self.square[:, None]
        J = np.concatenate([-A @ hat(self.y), A, A @ velocity[..., None], lens], -1)
        return np.asarray(J * self.points.focal[:, None, None])


def _normal_equations(
    view: _View, scale: float, n: int
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """Normal equations H, g of the first n unknowns, derivatives, weighted residuals (N, 2)."""
    J = view.jacobian()[..., :n]
    weight = 1.0 / (1.0 + view.squared / scale**2)
    weighted = weight[:, None] * view.r
    flat = J.reshape(-1, n)
    H = (flat * np.repeat(weight, 2)[:, None]).T @ flat
    H[np.diag_indices_from(H)] += 1e-12 * np.trace(H)
    return H, flat.T @ weighted.ravel(), J, weighted


def _stepped(at: LensFit, step: Float64Array) -> LensFit:
    turn = exp_so3(step[:3])
    return replace(
        at,
        R_cam_ref=turn @ at.R_cam_ref,
        t_cam_ref=at.t_cam_ref + step[3:6],
        late_s=at.late_s + float(step[6]),
        lens=at.lens + np.pad(step[_POSE:], (0, len(LENS) + _POSE - len(step))),
    )


def _with_errors(view: _View, scale: float, n: int) -> LensFit:
    """Return the fit with its standard deviations, the errors of a joint being correlated."""
    H, _, J, weighted = _normal_equations(view, scale, n)
    scores = np.einsum("nia,ni->na", J, weighted)
    cluster = view.points.cluster
    total = np.stack([np.bincount(cluster, column) for column in scores.T], -1)
    inverse = np.linalg.inv(H)
    factor = float(np.einsum("ka,ab,kb->", total, inverse, total)) / len(H)
    stddev: Float64Array = np.full(len(LENS), np.inf)
    stddev[: n - _POSE] = np.sqrt(np.maximum(np.diag(inverse)[_POSE:] * factor, 0.0))
    median = float(np.sqrt(np.median(view.squared)))
    return replace(view.at, stddev=stddev, median_px=median)
