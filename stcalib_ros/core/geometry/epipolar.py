"""Epipolar geometry of two views."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array


def sampson(
    E: Float64Array, x_a: Float64Array, x_b: Float64Array, variance_b: Float64Array | float = 1.0
) -> Float64Array:
    """Return signed Sampson distances (..., M) of ``x_a^T E x_b = 0`` on the planes z = 1.

    Parameters
    ----------
    E : (..., 3, 3) ndarray
        Essential matrix ``[t_a_b]_x R_a_b``.
    x_a, x_b : (..., M, 3) ndarray
        Homogeneous points.
    variance_b : (..., M) ndarray or float
        Variance of x_b over that of x_a.

    References
    ----------
    P. D. Sampson, "Fitting conic sections to very scattered data", 1982; R. Hartley and
    A. Zisserman, "Multiple view geometry", section 11.4.3.
    """
    line_a = x_b @ np.swapaxes(E, -1, -2)
    line_b = x_a @ E
    numerator = (x_a * line_a).sum(-1)
    return np.asarray(numerator / sampson_scale(line_a, line_b, variance_b))


def sampson_scale(
    line_a: Float64Array, line_b: Float64Array, variance_b: Float64Array | float
) -> Float64Array:
    """Return denominators (..., M) of Sampson distances, from epipolar lines (..., M, 3).

    Parameters
    ----------
    line_a, line_b : (..., M, 3) ndarray
        ``E x_b`` and ``E^T x_a``.
    variance_b : (..., M) ndarray or float
        Variance of x_b over that of x_a.
    """
    squares = (line_a[..., :2] ** 2).sum(-1) + variance_b * (line_b[..., :2] ** 2).sum(-1)
    return np.asarray(np.sqrt(np.maximum(squares, 1e-18)))


def decompose_essential(E: Float64Array) -> tuple[tuple[Float64Array, Float64Array], ...]:
    """Return the four rotations R_a_b and unit translations t_a_b of an essential matrix (3, 3).

    References
    ----------
    R. Hartley and A. Zisserman, "Multiple view geometry", result 9.19.
    """
    U, _, Vt = np.linalg.svd(E)
    U, Vt = U * np.sign(np.linalg.det(U)), Vt * np.sign(np.linalg.det(Vt))
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return tuple(
        (U @ turn @ Vt, sign * U[:, 2]) for turn in (quarter, quarter.T) for sign in (1, -1)
    )


def depths(
    R_a_b: Float64Array, t_a_b: Float64Array, x_a: Float64Array, x_b: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return the depths (M,) in both cameras of the points that two images have in common.

    Parameters
    ----------
    R_a_b : (3, 3) ndarray
    t_a_b : (3,) ndarray
    x_a, x_b : (M, 3) ndarray
        Homogeneous points on the planes z = 1.
    """
    turned = x_b @ R_a_b.T
    normal = np.cross(x_a, turned)
    square = np.maximum((normal**2).sum(-1), 1e-18)
    depth_a = (np.cross(t_a_b, turned) * normal).sum(-1) / square
    depth_b = (np.cross(t_a_b, x_a) * normal).sum(-1) / square
    return depth_a, depth_b
