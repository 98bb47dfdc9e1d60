"""Cameras by smooth trajectories, where images are sampled irregularly.

A joint that is free in every time bin is determined by the images there alone. With cameras of
several rates, or lost images, many bins have few. As a cubic B-spline, a trajectory is determined
by all its images. The velocities are those of the spline, whose noise is independent of the
residuals, so that offsets are not biased by it. That holds while images determine every coefficient
well: with one for each bin, offsets and poses are biased to where the splines can follow most of
the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.limits import NEAREST
from stcalib_ros.core.bundle.observations import Observations, nearest_bins
from stcalib_ros.core.bundle.outliers import outlier_limit_px
from stcalib_ros.core.bundle.parameters import Cameras
from stcalib_ros.core.bundle.residuals import camera_points, errors_px, noise_px
from stcalib_ros.core.bundle.state import BundleState, person_rows_of
from stcalib_ros.core.geometry import bsplines as splines
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.options import BundleOptions
from stcalib_ros.core.refinement import spline_solver
from stcalib_ros.core.refinement.limits import MAX_SPLINE_NOISE, MIN_OCCUPANCY
from stcalib_ros.core.refinement.spline_solver import (
    MARGIN,
    Sight,
    Trajectories,
    banded_factors,
    banded_solve,
    noise,
    solve,
)

_SPACING_S = 0.08
"""Seconds between coefficients. 0.4 % of a motion of 3 Hz is left out. Derived."""

_LEAST_SPACING = 2.0
"""Time bins between coefficients. Derived: two images of every camera determine one."""

_ACCELERATION = 10.0
"""Ratio. Standard deviation of the Gaussian prior of the accelerations over their mean square: it
only bridges gaps. Chosen."""


def with_splines(
    cameras: Sequence[LiftedCamera], last: Iteration, options: BundleOptions
) -> Iteration:
    """A round whose cameras suit smooth trajectories best; joints are those of the splines.

    The same where every camera has an image at nearly every knot, where people move faster than
    the splines, and where these do not settle.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
    last : Iteration
        At its optimum.
    options : BundleOptions
    """
    obs, state = last.observations, last.state
    if _evenness([cameras[c] for c in last.rig.cameras], last) >= MIN_OCCUPANCY:
        return last
    sigma = noise_px(obs, state)
    spacing = max(_LEAST_SPACING, _SPACING_S / obs.step_s)
    found = solve(
        trajectories(obs, state, sigma, options, spacing),
        Cameras(state.R_cam_ref, state.t_cam_ref, state.shift_s),
        step_s=spacing * obs.step_s,
        sigma=sigma,
        synchronised=state.synchronised,
    )
    if found is None or noise(*found, step_s=spacing * obs.step_s) > MAX_SPLINE_NOISE * sigma:
        return last
    smooth = _state_of(obs, state, *found, spacing)
    errors = errors_px(obs, smooth)
    fits = errors < outlier_limit_px(errors, smooth.inlier, options)
    return last.with_state(obs, smooth.with_inliers(smooth.inlier & fits))


def _evenness(members: Sequence[LiftedCamera], last: Iteration) -> float:
    """Smallest fraction of its time bins in which a camera has an image."""
    obs = last.observations
    occupied = []
    for camera, offset in zip(members, last.rig.offset_s, strict=True):
        knots = nearest_bins((camera.stamps + offset - obs.start_s) / obs.step_s)
        occupied.append(len(np.unique(knots)) / (1 + int(knots[-1] - knots[0])))
    return min(occupied)


def trajectories(
    obs: Observations, state: BundleState, sigma: float, options: BundleOptions, spacing: float
) -> tuple[Trajectories, ...]:
    """Lay splines through the joints of a state, with the image points that fit them.

    Parameters
    ----------
    obs : Observations
    state : BundleState
    sigma : float
        Noise of the image points, px.
    options : BundleOptions
        Says what does not fit.
    spacing : float
        Knots between coefficients.
    """
    x, step_s = _at_times_of_images(obs, state), spacing * obs.step_s
    cameras = Cameras(state.R_cam_ref, state.t_cam_ref, state.shift_s)
    limit = outlier_limit_px(errors_px(obs, state), state.inlier, options)
    known, late = state.triangulated(), _image_delays(obs, state)
    out = []
    for rows in person_rows_of(obs):
        at = _positions(obs, rows, spacing)
        determined = known[rows]
        if not determined.any():
            out.append(_of_nobody(len(cameras.t), at, determined.shape[1]))
            continue
        squares = (state.A[rows] ** 2).sum(-1) * determined
        square = squares.sum(0) / np.maximum(determined.sum(0), 1) / 3.0
        square = np.maximum(square, 1e-3 * square.max() + 1e-30)
        precision = (sigma / (_ACCELERATION * step_s**2)) ** 2 / square
        depth = np.linalg.norm(state.X[rows], axis=-1)[determined]
        gain = float(np.median(obs.focal[rows][obs.observed[rows]]) / np.median(depth))
        coefficients = _through(
            at, state.X[rows], gain**2 * determined.astype(np.float64), precision
        )
        sights = []
        for c in range(len(cameras.t)):
            there = np.flatnonzero(obs.track[rows, c] >= 0)
            position = at[there] + late[rows][there, c] / step_s
            seen = obs.observed[rows][there, c]
            sight = Sight(position, x[rows][there, c], obs.focal[rows][there, c] * seen)
            away_px = spline_solver.errors_px(sight, cameras.only(c), coefficients, step_s)
            inside = (away_px < limit) & determined[there]
            sights.append(replace(sight, focal=sight.focal * inside))
        out.append(Trajectories(tuple(sights), coefficients, precision))
    return tuple(out)


def _of_nobody(C: int, position: Float64Array, J: int) -> Trajectories:
    """Of a person of whom nothing fits: no points."""
    nothing = Sight(np.zeros(0), np.zeros((0, J, 2)), np.zeros((0, J)))
    coefficients = np.zeros((_n_coefficients(position), J, 3))
    return Trajectories((nothing,) * C, coefficients, np.ones(J))


def _n_coefficients(position: Float64Array) -> int:
    return int(position[-1]) + splines.SUPPORT + MARGIN


def _positions(obs: Observations, rows: slice, spacing: float) -> Float64Array:
    """The knots of one person's rows, in coefficients."""
    return np.asarray((obs.time_bin[rows] - obs.time_bin[rows][0]) / spacing + MARGIN)


def _image_delays(obs: Observations, state: BundleState) -> Float64Array:
    """Time (N, C) of each image after its time bin, but for the correction of its offset, s."""
    times = replace(obs, row=None).point_times()
    late = state.cameras.delay(times) - state.shift_s[:, None]
    return np.asarray(obs.phi + late[..., 0])


def _at_times_of_images(obs: Observations, state: BundleState) -> Float64Array:
    """Keypoints (N, C, J, 2) where they would be if all rows of an image were taken at once."""
    if obs.row is None:
        return obs.x.astype(np.float64)
    u = []
    for one in (obs, replace(obs, row=None)):
        Z = camera_points(one, state)
        u.append(Z[..., :2] / np.where(Z[..., 2:] > NEAREST, Z[..., 2:], np.inf))
    return np.asarray(obs.x - (u[0] - u[1]))


def _through(
    position: Float64Array, X: Float64Array, weight: Float64Array, precision: Float64Array
) -> Float64Array:
    """Coefficients (K, J, 3) of splines through points (N, J, 3) of some weight (N, J)."""
    K = _n_coefficients(position)
    N = splines.summed_squares(position, K, weight[..., None, None] * np.eye(3))
    right = splines.summed(position, K, splines.basis(position), weight[..., None] * X)
    factors = banded_factors(N + splines.smoothness(K, precision))
    return banded_solve(factors, right[..., None])[..., 0]


def _state_of(
    obs: Observations,
    state: BundleState,
    cameras: Cameras,
    people: Sequence[Trajectories],
    spacing: float,
) -> BundleState:
    """The state at cameras and splines: joints and their motion at the knots."""
    X, V, A = (np.empty_like(state.X) for _ in range(3))
    for rows, one in zip(person_rows_of(obs), people, strict=True):
        at = _positions(obs, rows, spacing)
        for n, values in enumerate((X, V, A)):
            values[rows] = splines.values(at, one.coefficients, n) / (spacing * obs.step_s) ** n
    return replace(
        state, R_cam_ref=cameras.R, t_cam_ref=cameras.t, shift_s=cameras.shift, X=X, V=V, A=A
    )
