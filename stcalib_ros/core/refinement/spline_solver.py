"""Cameras and smooth trajectories that explain the keypoints best together.

The trajectories are cubic B-splines, which are eliminated one by one: their normal equations have a
narrow band.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from stcalib_ros.core.bundle.normal_equations import ReducedSystem
from stcalib_ros.core.bundle.parameters import Cameras, ParameterLayout
from stcalib_ros.core.bundle.point_views import PointTimes
from stcalib_ros.core.bundle.residuals import Projection
from stcalib_ros.core.geometry import bsplines as splines
from stcalib_ros.core.geometry.robust import CAUCHY, LEAST_SHARE, RAYLEIGH_MEDIAN
from stcalib_ros.core.model.arrays import Float64Array

MARGIN = 2
"""Coefficients. So many lie before the first image; offsets may move by half of that. Numerical."""

_ITERATIONS = 12
"""Count. Gauss-Newton steps at most. Numerical."""

_CONVERGED = 0.1
"""Standard deviations. Done when a step moves the cameras by less. Numerical."""

_RIDGE = 1e-12
"""Ratio to the mean trace. Keeps coefficients that nothing determines finite. Numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """Keypoints of one person in one camera.

    Attributes
    ----------
    position : (n,) ndarray
        Times of the images by the offsets of the rig, in coefficients.
    x : (n, J, 2) ndarray
        On the plane z = 1.
    focal : (n, J) ndarray
        Pixels per unit of x; 0 where a keypoint does not take part.
    """

    position: Float64Array
    x: Float64Array
    focal: Float64Array

    def position_at(self, shift_s: float, step_s: float) -> Float64Array:
        """Times (n,) of the images by a corrected time offset, in coefficients."""
        return np.asarray(self.position + shift_s / step_s)


@dataclass(frozen=True, slots=True, eq=False)
class Trajectories:
    """The joints of one person over time, and their keypoints.

    Attributes
    ----------
    sights : tuple of Sight
        By camera.
    coefficients : (K, J, 3) ndarray
        Of the splines, in the reference frame.
    precision : (J,) ndarray
        Of their second differences, in units of the noise of the keypoints.
    """

    sights: tuple[Sight, ...]
    coefficients: Float64Array
    precision: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class EliminatedSplines:
    """The part of a person in the system of the cameras, and what its splines need to follow."""

    system: ReducedSystem
    factors: tuple[Float64Array, ...]
    gradient: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class _Linearised:
    """Weighted residuals (n, J, 2) and their derivatives by camera (n, J, 2, 7) and joint (3)."""

    r: Float64Array
    by_camera: Float64Array
    by_joint: Float64Array


def solve(
    people: Sequence[Trajectories],
    cameras: Cameras,
    *,
    step_s: float,
    sigma: float,
    synchronised: bool = False,
) -> tuple[Cameras, tuple[Trajectories, ...]] | None:
    """Gauss-Newton steps of cameras and splines on the robust cost; None if they do not settle.

    Parameters
    ----------
    people : sequence of Trajectories
    cameras : Cameras
        Start; the first is the reference, and the first baseline keeps its length.
    step_s : float
        Between coefficients.
    sigma : float
        Noise of the image points, px.
    synchronised : bool
        Offsets stay as they are.
    """
    length, layout = cameras.length(), ParameterLayout(len(cameras.t), synchronised)
    for _ in range(_ITERATIONS):
        parts = [eliminate(one, cameras, step_s, sigma) for one in people]
        H, g = np.sum([p.system.H for p in parts], 0), np.sum([p.system.g for p in parts], 0)
        d = -layout.solve(H, g, cameras)
        people = [
            _followed(one, part, cameras, d, step_s, sigma)
            for one, part in zip(people, parts, strict=True)
        ]
        cameras = layout.retract(cameras, d)
        grow = length / cameras.length()
        people = [replace(one, coefficients=grow * one.coefficients) for one in people]
        cameras = cameras.scaled(grow)
        if np.abs(cameras.shift).max() > MARGIN / 2 * step_s:
            return None
        flat = d.ravel()
        if flat @ H @ flat < (_CONVERGED * sigma) ** 2:
            return cameras, tuple(people)
    return None


def noise(cameras: Cameras, people: Sequence[Trajectories], *, step_s: float) -> float:
    """Standard deviation (px, per axis) of the keypoints, from their median.

    As in `robust_scale`: a coefficient takes up three of their coordinates.
    """
    observed = [one for one in people if any(sight.focal.any() for sight in one.sights)]
    if not observed:
        return float("inf")
    errors = []
    for one in observed:
        for c, sight in enumerate(one.sights):
            errors.append(
                errors_px(sight, cameras.only(c), one.coefficients, step_s)[sight.focal > 0.0]
            )
    every = np.concatenate(errors)
    unknown = 1.5 * sum(one.coefficients[..., 0].size for one in observed)
    fraction = max(1.0 - unknown / len(every), LEAST_SHARE)
    return float(np.median(every)) / RAYLEIGH_MEDIAN / float(np.sqrt(fraction))


def eliminate(
    one: Trajectories, cameras: Cameras, step_s: float, sigma: float
) -> EliminatedSplines:
    """Eliminate the splines of a person: the part of that person in the system of the cameras."""
    K, J, _ = one.coefficients.shape
    layout = ParameterLayout(len(cameras.t))
    k, scale = layout.size, CAUCHY * sigma
    H, g = np.zeros((k, k)), np.zeros(k)
    N, W = splines.smoothness(K, one.precision), np.zeros((K, J, 3, k + 1))
    W[..., -1] = _pull(one)
    for c, sight in enumerate(one.sights):
        position = sight.position_at(cameras.shift[c], step_s)
        s = _linearised(sight, cameras.only(c), one.coefficients, step_s, scale)
        own = layout.of_camera(c)
        by_camera = s.by_camera.reshape(-1, layout.block)
        H[own, own] = by_camera.T @ by_camera
        g[own] = by_camera.T @ s.r.ravel()
        transposed, weight = s.by_joint.swapaxes(-1, -2), splines.basis(position)
        W[..., own] = splines.summed(position, K, weight, transposed @ s.by_camera)
        W[..., -1] += splines.summed(position, K, weight, (transposed @ s.r[..., None])[..., 0])
        N += splines.summed_squares(position, K, transposed @ s.by_joint)
    factors = banded_factors(N)
    solved = banded_solve(factors, W).reshape(-1, k + 1)
    gain = W.reshape(-1, k + 1)[:, :-1].T @ solved
    return EliminatedSplines(ReducedSystem(H - gain[:, :-1], g - gain[:, -1]), factors, W[..., -1])


def _pull(one: Trajectories) -> Float64Array:
    """Gradient (K, J, 3) of the prior."""
    d = one.precision[:, None] * np.diff(one.coefficients, 2, axis=0)
    out = np.zeros_like(one.coefficients)
    for n, factor in enumerate((1.0, -2.0, 1.0)):
        out[n : len(out) - 2 + n] += factor * d
    return out


def _followed(
    one: Trajectories,
    part: EliminatedSplines,
    cameras: Cameras,
    d: Float64Array,
    step_s: float,
    sigma: float,
) -> Trajectories:
    """The splines after a step (C, 7) of the cameras."""
    right = part.gradient.copy()
    K = len(right)
    for c, sight in enumerate(one.sights):
        s = _linearised(sight, cameras.only(c), one.coefficients, step_s, CAUCHY * sigma)
        moved = s.by_joint.swapaxes(-1, -2) @ (s.by_camera @ d[c])[..., None]
        position = sight.position_at(cameras.shift[c], step_s)
        right += splines.summed(position, K, splines.basis(position), moved[..., 0])
    step = banded_solve(part.factors, right[..., None])[..., 0]
    return replace(one, coefficients=one.coefficients - step)


def errors_px(
    sight: Sight, camera: Cameras, coefficients: Float64Array, step_s: float
) -> Float64Array:
    """Reprojection errors (n, J) of one camera, px; 0 behind it."""
    at = _project(sight, camera, coefficients, step_s)
    return np.asarray(np.sqrt(at.squared * at.ahead).reshape(sight.focal.shape))


def _project(
    sight: Sight, camera: Cameras, coefficients: Float64Array, step_s: float
) -> Projection:
    """Project the splines of a person into one camera; points are (n J)."""
    position = sight.position_at(camera.shift[0], step_s)
    R, m = camera.R[0], sight.focal.size
    y = R @ splines.values(position, coefficients).reshape(m, 3).T
    velocity = R @ splines.values(position, coefficients, 1).reshape(m, 3).T / step_s
    times = PointTimes(np.zeros((1, 1)), np.zeros((1, 1)))
    x = sight.x.reshape(1, m, 2).swapaxes(1, 2)
    return Projection(camera, y[None], velocity[None], times, x, sight.focal.reshape(1, m))


def _linearised(
    sight: Sight, camera: Cameras, coefficients: Float64Array, step_s: float, scale: float
) -> _Linearised:
    """Residuals of one camera, weighted for a Cauchy loss of a scale (px), with derivatives."""
    n, J = sight.focal.shape
    at = _project(sight, camera, coefficients, step_s)
    A, r = at.rows(scale)
    layout = ParameterLayout(1)
    by_camera = at.camera_columns(A, layout)[0]
    by_joint = at.point_columns(A)[0]
    return _Linearised(
        r[0].T.reshape(n, J, 2),
        by_camera.transpose(2, 1, 0).reshape(n, J, 2, layout.block),
        by_joint.transpose(2, 0, 1).reshape(n, J, 2, 3),
    )


def banded_factors(N: Float64Array) -> tuple[Float64Array, ...]:
    """Cholesky factors, by joint, of blocks (4, K, J, 3, 3)."""
    N[0] += _RIDGE * np.trace(N[0], axis1=-2, axis2=-1).mean(0)[:, None, None] * np.eye(3)
    return tuple(cholesky_banded(one, lower=True) for one in splines.banded(N))


def banded_solve(factors: tuple[Float64Array, ...], right: Float64Array) -> Float64Array:
    """Solutions (K, J, 3, m) of right sides (K, J, 3, m)."""
    K, J, _, m = right.shape
    by_joint = right.transpose(1, 0, 2, 3).reshape(J, 3 * K, m)
    pairs = zip(factors, by_joint, strict=True)
    found = np.stack([cho_solve_banded((factor, True), one) for factor, one in pairs])
    return np.asarray(found.reshape(J, K, 3, m).transpose(1, 0, 2, 3))
