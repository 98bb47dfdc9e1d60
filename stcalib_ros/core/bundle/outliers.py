"""Outlier removal, and what is left connected (Section IV)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stcalib_ros.core.bundle.limits import MIN_SHARED_FRACTION, MIN_SHARED_POINTS
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.residuals import errors_px, median_error
from stcalib_ros.core.bundle.state import BundleState
from stcalib_ros.core.geometry.graphs import components
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
