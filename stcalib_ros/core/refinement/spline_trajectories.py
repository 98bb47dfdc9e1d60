"""Cameras by smooth trajectories, where images lie at uneven moments.

A joint that is free at every knot is told by the images there alone. With cameras of several
rates, or lost images, many knots have few. As a cubic B-spline, a trajectory is told by all its
images. The velocities are those of the spline, whose noise the residuals have nothing to do with,
so that offsets are not drawn by it. That holds while images tell every coefficient well: with one
for each knot, offsets and poses are drawn to where the splines can follow most of the noise.
Trajectories are eliminated one by one: their normal equations have a narrow band.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.levenberg_marquardt import solve_reduced
from stcalib_ros.core.bundle.normal_equations import CAMERA, NEAREST, Cameras, ReducedSystem
from stcalib_ros.core.bundle.observations import Observations, nearest_knots
from stcalib_ros.core.bundle.outliers import outlier_limit_px
from stcalib_ros.core.bundle.residuals import at_images, errors_px, robust_scale
from stcalib_ros.core.bundle.state import BundleState, person_rows_of
from stcalib_ros.core.geometry import bsplines as splines
from stcalib_ros.core.geometry.robust import CAUCHY, LEAST_SHARE, MIN_SCALE_PX, RAYLEIGH_MEDIAN
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.options import BundleOptions

_ENOUGH = 0.95
"""Share of the knots at which every camera has an image: free points lose nothing there."""
_SPACING_S = 0.08
"""Between coefficients: 0.4 % of a motion of 3 Hz is left out."""
_LEAST_SPACING = 2.0
"""Knots between coefficients."""
_AS_GOOD = 1.3
"""Noise that splines leave over that of free points where they hold what people do."""
_ACCELERATION = 10.0
"""Deviation of the prior of accelerations over what they are: it only carries over gaps."""
_MARGIN = 2
"""Coefficients before the first moment; offsets move by half of that at most."""
_ITERATIONS = 12
_SETTLED = 0.1
_RIDGE = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What one camera sees of one person.

    Attributes
    ----------
    position : (n,) ndarray
        Times of the images by the offsets of the rig, in coefficients.
    x : (n, J, 2) ndarray
        On the plane z = 1.
    focal : (n, J) ndarray
        Pixels per unit of x; 0 where a point does not take part.
    """

    position: Float64Array
    x: Float64Array
    focal: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class Trajectories:
    """The joints of one person over time, and who sees them.

    Attributes
    ----------
    sights : tuple of Sight
        By camera.
    coefficients : (K, J, 3) ndarray
        Of the splines, in the reference frame.
    precision : (J,) ndarray
        Of their second differences, in units of the noise of the image points.
    """

    sights: tuple[Sight, ...]
    coefficients: Float64Array
    precision: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class EliminatedSplines:
    """A person's share in the system of the cameras, and what its splines need to follow."""

    system: ReducedSystem
    factors: tuple[Float64Array, ...]
    gradient: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """Weighted residuals (n, J, 2) and their derivatives by camera (7) and joint (3)."""

    position: Float64Array
    r: Float64Array
    by_camera: Float64Array
    by_joint: Float64Array


def with_splines(cameras: Sequence[LiftedCamera], last: Iteration, b: BundleOptions) -> Iteration:
    """A round whose cameras suit smooth trajectories best; joints are those of the splines.

    The same where every camera has an image at nearly every knot, where people move faster than
    the splines, and where these do not settle.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
    last : Iteration
        At its optimum.
    b : BundleOptions
    """
    o, state = last.observations, last.state
    if _evenness([cameras[c] for c in last.rig.cameras], last) >= _ENOUGH:
        return last
    sigma = max(robust_scale(errors_px(o, state), state.used), MIN_SCALE_PX)
    spacing = max(_LEAST_SPACING, _SPACING_S / o.step_s)
    found = solve(
        trajectories(o, state, sigma, b, spacing),
        Cameras(state.R_cam_ref, state.t_cam_ref, state.shift_s),
        step_s=spacing * o.step_s,
        sigma=sigma,
        synchronised=state.synchronised,
    )
    if found is None or noise(*found, step_s=spacing * o.step_s) > _AS_GOOD * sigma:
        return last
    return last.moved(o, _state_of(o, state, *found, spacing))


def _evenness(members: Sequence[LiftedCamera], last: Iteration) -> float:
    """Share of the knots between its first and last image at which a camera has one; the least."""
    o = last.observations
    share = []
    for camera, offset in zip(members, last.rig.offset_s, strict=True):
        knots = nearest_knots((camera.stamps + offset - o.start_s) / o.step_s)
        share.append(len(np.unique(knots)) / (1 + int(knots[-1] - knots[0])))
    return min(share)


def trajectories(
    o: Observations, state: BundleState, sigma: float, b: BundleOptions, spacing: float
) -> tuple[Trajectories, ...]:
    """Splines through the joints of a state, and the image points that fit them.

    Parameters
    ----------
    o : Observations
    state : BundleState
    sigma : float
        Noise of the image points, px.
    b : BundleOptions
        Says what does not fit.
    spacing : float
        Knots between coefficients.
    """
    x, step_s = _at_times_of_images(o, state), spacing * o.step_s
    cameras = Cameras(state.R_cam_ref, state.t_cam_ref, state.shift_s)
    limit = outlier_limit_px(errors_px(o, state), state.used, b)
    known = state.used.sum(1) >= 2
    out = []
    for rows in person_rows_of(o):
        at = _positions(o, rows, spacing)
        told = known[rows]
        if not told.any():
            out.append(_of_nobody(len(cameras.t), at, told.shape[1]))
            continue
        squares = (state.A[rows] ** 2).sum(-1) * told
        square = squares.sum(0) / np.maximum(told.sum(0), 1) / 3.0
        square = np.maximum(square, 1e-3 * square.max() + 1e-30)
        precision = (sigma / (_ACCELERATION * step_s**2)) ** 2 / square
        depth = np.linalg.norm(state.X[rows], axis=-1)[told]
        gain = float(np.median(o.focal[rows][o.seen[rows]]) / np.median(depth))
        coefficients = _through(at, state.X[rows], gain**2 * told, precision)
        sights = []
        for c in range(len(cameras.t)):
            there = np.flatnonzero(o.track[rows, c] >= 0)
            position = at[there] + o.phi[rows][there, c] / step_s
            seen = o.seen[rows][there, c]
            sight = Sight(position, x[rows][there, c], o.focal[rows][there, c] * seen)
            away = _look(sight, cameras, c, coefficients, step_s, np.inf).r
            inside = ((away**2).sum(-1) < limit**2) & told[there]
            sights.append(replace(sight, focal=sight.focal * inside))
        out.append(Trajectories(tuple(sights), coefficients, precision))
    return tuple(out)


def _of_nobody(C: int, position: Float64Array, J: int) -> Trajectories:
    """Of a person of whom nothing fits: no points."""
    nothing = Sight(np.zeros(0), np.zeros((0, J, 2)), np.zeros((0, J)))
    coefficients = np.zeros((_n_coefficients(position), J, 3))
    return Trajectories((nothing,) * C, coefficients, np.ones(J))


def _n_coefficients(position: Float64Array) -> int:
    return int(position[-1]) + splines.SUPPORT + _MARGIN


def _positions(o: Observations, rows: slice, spacing: float) -> Float64Array:
    """The knots of one person's rows, in coefficients."""
    return np.asarray((o.knot[rows] - o.knot[rows][0]) / spacing + _MARGIN)


def _at_times_of_images(o: Observations, state: BundleState) -> Float64Array:
    """Image points (N, C, J, 2) where they would be if all rows of an image were one moment."""
    if o.row is None:
        return o.x
    R = np.swapaxes(state.R_cam_ref, -1, -2)
    u = []
    for one in (o, replace(o, row=None)):
        Y = at_images(one, state) @ R + state.t_cam_ref[:, None]
        u.append(Y[..., :2] / np.where(Y[..., 2:] > NEAREST, Y[..., 2:], np.inf))
    return np.asarray(o.x - (u[0] - u[1]))


def _through(
    position: Float64Array, X: Float64Array, weight: Float64Array, precision: Float64Array
) -> Float64Array:
    """Coefficients (K, J, 3) of splines through points (N, J, 3) of some weight (N, J)."""
    K = _n_coefficients(position)
    N = splines.summed_squares(position, K, weight[..., None, None] * np.eye(3))
    right = splines.summed(position, K, splines.basis(position), weight[..., None] * X)
    factors = _factors(N + splines.smoothness(K, precision))
    return _solved(factors, right[..., None])[..., 0]


def _factors(N: Float64Array) -> tuple[Float64Array, ...]:
    """Cholesky factors, by joint, of blocks (4, K, J, 3, 3)."""
    N[0] += _RIDGE * np.trace(N[0], axis1=-2, axis2=-1).mean(0)[:, None, None] * np.eye(3)
    return tuple(cholesky_banded(one, lower=True) for one in splines.banded(N))


def _solved(factors: tuple[Float64Array, ...], right: Float64Array) -> Float64Array:
    """Solutions (K, J, 3, m) of right sides (K, J, 3, m)."""
    K, J, _, m = right.shape
    by_joint = right.transpose(1, 0, 2, 3).reshape(J, 3 * K, m)
    pairs = zip(factors, by_joint, strict=True)
    found = np.stack([cho_solve_banded((factor, True), one) for factor, one in pairs])
    return np.asarray(found.reshape(J, K, 3, m).transpose(1, 0, 2, 3))


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
    length = float(np.linalg.norm(cameras.t[1]))
    for _ in range(_ITERATIONS):
        parts = [eliminate(one, cameras, step_s, sigma) for one in people]
        system = ReducedSystem(
            np.sum([p.system.H for p in parts], 0), np.sum([p.system.g for p in parts], 0)
        )
        d = -solve_reduced(system, cameras.t, synchronised=synchronised)
        people = [
            _followed(one, part, cameras, d, step_s, sigma)
            for one, part in zip(people, parts, strict=True)
        ]
        t = cameras.t + d[:, 3:6]
        grow = length / float(np.linalg.norm(t[1]))
        people = [replace(one, coefficients=grow * one.coefficients) for one in people]
        R, shift = exp_so3(d[:, :3]) @ cameras.R, cameras.shift + d[:, 6]
        cameras = Cameras(R, grow * t, shift)
        if np.abs(shift).max() > _MARGIN / 2 * step_s:
            return None
        flat = d.ravel()
        if flat @ system.H @ flat < (_SETTLED * sigma) ** 2:
            return cameras, tuple(people)
    return None


def noise(cameras: Cameras, people: Sequence[Trajectories], *, step_s: float) -> float:
    """Standard deviation (px, per axis) of the image points, from their median.

    As `stba.robust_scale` has it: a coefficient takes three of their coordinates.
    """
    seen = [one for one in people if any(sight.focal.any() for sight in one.sights)]
    if not seen:
        return float("inf")
    errors = []
    for one in seen:
        for c, sight in enumerate(one.sights):
            r = _look(sight, cameras, c, one.coefficients, step_s, np.inf).r
            errors.append(np.sqrt((r**2).sum(-1))[sight.focal > 0.0])
    every = np.concatenate(errors)
    unknown = 1.5 * sum(one.coefficients[..., 0].size for one in seen)
    share = max(1.0 - unknown / len(every), LEAST_SHARE)
    return float(np.median(every)) / RAYLEIGH_MEDIAN / float(np.sqrt(share))


def eliminate(
    one: Trajectories, cameras: Cameras, step_s: float, sigma: float
) -> EliminatedSplines:
    """A person's share in the system of the cameras, its splines eliminated."""
    K, J, _ = one.coefficients.shape
    k = CAMERA * len(cameras.t)
    H, g = np.zeros((k, k)), np.zeros(k)
    N, W = splines.smoothness(K, one.precision), np.zeros((K, J, 3, k + 1))
    W[..., -1] = _pull(one)
    for c, sight in enumerate(one.sights):
        s = _look(sight, cameras, c, one.coefficients, step_s, CAUCHY * sigma)
        own = slice(CAMERA * c, CAMERA * (c + 1))
        by_camera = s.by_camera.reshape(-1, CAMERA)
        H[own, own] = by_camera.T @ by_camera
        g[own] = by_camera.T @ s.r.ravel()
        transposed, weight = s.by_joint.swapaxes(-1, -2), splines.basis(s.position)
        W[..., own] = splines.summed(s.position, K, weight, transposed @ s.by_camera)
        W[..., -1] += splines.summed(s.position, K, weight, (transposed @ s.r[..., None])[..., 0])
        N += splines.summed_squares(s.position, K, transposed @ s.by_joint)
    factors = _factors(N)
    solved = _solved(factors, W).reshape(-1, k + 1)
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
        s = _look(sight, cameras, c, one.coefficients, step_s, CAUCHY * sigma)
        moved = s.by_joint.swapaxes(-1, -2) @ (s.by_camera @ d[c])[..., None]
        right += splines.summed(s.position, K, splines.basis(s.position), moved[..., 0])
    step = _solved(part.factors, right[..., None])[..., 0]
    return replace(one, coefficients=one.coefficients - step)


def _look(
    sight: Sight, cameras: Cameras, c: int, coefficients: Float64Array, step_s: float, scale: float
) -> _Seen:
    """Residuals of one camera, weighted for a Cauchy loss of a scale (px), with derivatives."""
    R = cameras.R[c]
    position = sight.position + cameras.shift[c] / step_s
    y = splines.values(position, coefficients) @ R.T
    velocity = splines.values(position, coefficients, 1) @ R.T / step_s
    Z = y + cameras.t[c]
    ahead = Z[..., 2] > NEAREST
    depth = np.where(ahead, Z[..., 2], 1.0)
    u = Z[..., :2] / depth[..., None]
    r = (u - sight.x) * (sight.focal * ahead)[..., None]
    weight = 1.0 / np.sqrt(1.0 + (r**2).sum(-1) / scale**2)
    gain = sight.focal * ahead * weight / depth
    rows = np.zeros((*gain.shape, 2, 3))
    rows[..., 0, 0] = rows[..., 1, 1] = gain
    rows[..., 2] = -gain[..., None] * u
    by_offset = rows @ velocity[..., None]
    turned = np.cross(y[..., None, :], rows)
    return _Seen(
        position, weight[..., None] * r, np.concatenate([turned, rows, by_offset], -1), rows @ R
    )


def _state_of(
    o: Observations,
    state: BundleState,
    cameras: Cameras,
    people: Sequence[Trajectories],
    spacing: float,
) -> BundleState:
    """The state at cameras and splines: joints and their motion at the knots."""
    X, V, A = (np.empty_like(state.X) for _ in range(3))
    for rows, one in zip(person_rows_of(o), people, strict=True):
        at = _positions(o, rows, spacing)
        for n, values in enumerate((X, V, A)):
            values[rows] = splines.values(at, one.coefficients, n) / (spacing * o.step_s) ** n
    return replace(
        state, R_cam_ref=cameras.R, t_cam_ref=cameras.t, shift_s=cameras.shift, X=X, V=V, A=A
    )
