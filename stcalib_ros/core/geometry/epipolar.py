"""Epipolar geometry of two views."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array


def sampson(
    E: Float64Array, x_a: Float64Array, x_b: Float64Array, variance_b: Float64Array | float = 1.0
) -> Float64Array:
    """Signed Sampson distances (M,) of ``x_a^T E x_b = 0`` on the planes z = 1.

    Parameters
    ----------
    E : (..., 3, 3) ndarray
        Essential matrix ``[t_a_b]_x R_a_b``.
    x_a, x_b : (..., M, 3) ndarray
        Homogeneous points.
    variance_b : (..., M) ndarray or float
        Variance of x_b over that of x_a.
    """
    line_a = x_b @ np.swapaxes(E, -1, -2)
    line_b = x_a @ E
    numerator = (x_a * line_a).sum(-1)
    return np.asarray(numerator / _sampson_scale(line_a, line_b, variance_b))


def _sampson_scale(
    line_a: Float64Array, line_b: Float64Array, variance_b: Float64Array | float
) -> Float64Array:
    squares = (line_a[..., :2] ** 2).sum(-1) + variance_b * (line_b[..., :2] ** 2).sum(-1)
    return np.asarray(np.sqrt(np.maximum(squares, 1e-18)))
