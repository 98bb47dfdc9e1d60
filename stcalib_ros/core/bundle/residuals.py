"""Reprojection errors and their scale."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.bundle.normal_equations import NEAREST
from stcalib_ros.core.bundle.observations import Observations, blocks_of
from stcalib_ros.core.bundle.state import BundleState
from stcalib_ros.core.geometry.robust import LEAST_SHARE, RAYLEIGH_MEDIAN
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray


def at_images(
    o: Observations, state: BundleState, rows: slice | IntArray = slice(None)
) -> Float64Array:
    """Joints (N, C, J, 3) in the reference frame at the time of each camera's image."""
    when = (o.elapsed(rows) + state.shift_s[:, None])[..., None]
    V, A = state.V[rows][:, None], state.A[rows][:, None]
    return np.asarray(state.X[rows][:, None] + when * (V + 0.5 * when * A))


def residuals_px(
    o: Observations, state: BundleState, rows: slice = slice(None)
) -> tuple[Float64Array, BoolArray]:
    """Reprojection residuals (N, C, J, 2), px, and which of them take part and are finite."""
    R = np.swapaxes(state.R_cam_ref, -1, -2)
    Y = at_images(o, state, rows) @ R + state.t_cam_ref[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        r = (Y[..., :2] / Y[..., 2:] - o.x[rows]) * o.focal[rows][..., None]
    r[Y[..., 2] < NEAREST] = np.inf
    return r, state.used[rows] & np.isfinite(r).all(-1)


def errors_px(o: Observations, state: BundleState) -> Float64Array:
    """Reprojection errors (N, C, J), px; NaN where nothing was seen or no point is known.

    As precise as the image points are.
    """
    out = np.empty(o.seen.shape, o.x.dtype)
    for rows in blocks_of(o):
        r = residuals_px(o, state, rows)[0]
        known = o.seen[rows] & (state.used[rows].sum(1) >= 2)[:, None]
        out[rows] = np.where(known, np.sqrt(r[..., 0] ** 2 + r[..., 1] ** 2), np.nan)
    return out


def median_error(errors: Float64Array, used: BoolArray) -> float:
    """Median of the used and finite errors (N, C, J), px; NaN if there is none."""
    chosen = errors[used & np.isfinite(errors)]
    return float(np.median(chosen, overwrite_input=True)) if len(chosen) else float("nan")


def robust_scale(errors: Float64Array, used: BoolArray) -> float:
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
