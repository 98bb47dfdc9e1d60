"""Outlier removal, and what is left connected (Section IV)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stcalib_ros.core.bundle.limits import (
    BODY_REACH,
    MAX_DEPTH_SIGMA,
    MAX_PATH_DEVIATION,
    MIN_SHARED_FRACTION,
    MIN_SHARED_POINTS,
)
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.residuals import errors_px, median_error
from stcalib_ros.core.bundle.state import BundleState, person_rows_of
from stcalib_ros.core.geometry.graphs import components
from stcalib_ros.core.integration.association import SLOT_SAMPLES
from stcalib_ros.core.model.arrays import BoolArray, Float32Array, Float64Array, IntArray
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.options import BundleOptions


def image_points(members: Sequence[LiftedCamera]) -> IntArray:
    """Image points (C,) of all tracks of some cameras, matched or not."""
    return np.array([sum(np.isfinite(t.x[..., 0]).sum() for t in m.tracks) for m in members])


def drop_outliers(obs: Observations, state: BundleState, options: BundleOptions) -> BundleState:
    """Leave out observations above three times the median error (Section IV)."""
    errors = errors_px(obs, state)
    inside = np.isfinite(errors) & obs.observed
    if not inside.any():
        return replace(state, inlier=inside)
    used = inside & (errors < outlier_limit_px(errors, state.inlier, options))
    return state.with_inliers(used)


def outlier_limit_px(errors: Float32Array, used: BoolArray, options: BundleOptions) -> float:
    """Error above which an image point is an outlier, by the median of the used ones."""
    return max(options.outlier_floor_px, options.outlier_factor * median_error(errors, used))


def connected(used: BoolArray, total: IntArray) -> list[tuple[int, ...]]:
    """Groups of cameras connected by common keypoints, largest group first.

    A spurious match of strangers does not connect two cameras.

    Parameters
    ----------
    inlier : (N, C, J) ndarray of bool
    total : (C,) ndarray of int
        Image points of each camera, matched or not.
    """
    seen = used.transpose(1, 0, 2).reshape(used.shape[1], -1).astype(np.float32)
    shared: Float64Array = seen @ seen.T
    needed = np.maximum(
        MIN_SHARED_POINTS, MIN_SHARED_FRACTION * np.minimum(total[:, None], total[None])
    )
    return components(shared >= needed)


def implausible_joints(obs: Observations, state: BundleState, variance: Float64Array) -> BoolArray:
    """Joints (N, J) that are far from their body, and those of bodies that are off their path.

    Two cameras side by side take a keypoint of the other side of a body, or of somebody else at
    that height, for one at another depth: no reprojection error tells.

    Parameters
    ----------
    obs : Observations
    state : BundleState
    variance : (N, J) ndarray
        Of the joints along the direction that is known least; NaN where not triangulated.
    """
    sigma = np.sqrt(variance)
    known = np.isfinite(sigma)
    X = np.where(known[..., None], state.X, np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of bodies without a known joint
        middle, usual = np.nanmedian(X, 1), np.nanmedian(sigma, 1)
    away = np.linalg.norm(X - middle[:, None], axis=-1) > BODY_REACH + MAX_DEPTH_SIGMA * sigma
    off = np.zeros(len(X), dtype=bool)
    for rows in person_rows_of(obs):
        since = obs.time_bin[rows] - obs.time_bin[rows][0]
        path = np.full((int(since[-1]) + 1, 3), np.nan)
        path[since] = middle[rows]
        stray = np.linalg.norm(path - _running_median(path), axis=-1)[since]
        off[rows] = stray > MAX_PATH_DEVIATION + MAX_DEPTH_SIGMA * usual[rows]
    return np.asarray(known & (away | off[:, None]))


def _running_median(path: Float64Array) -> Float64Array:
    """Medians (K, 3) of what is known of a path within a slot of time to either side."""
    padded = np.pad(path, ((SLOT_SAMPLES, SLOT_SAMPLES), (0, 0)), constant_values=np.nan)
    nearby = np.lib.stride_tricks.sliding_window_view(padded, 2 * SLOT_SAMPLES + 1, axis=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of gaps longer than that
        return np.asarray(np.nanmedian(nearby, axis=-1))
