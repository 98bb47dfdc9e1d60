"""Translation from the epipolar constraint with the rotation known (Section III-B)."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array


def translation_direction(
    R_a_b: Float64Array, x_a: Float64Array, x_b: Float64Array
) -> Float64Array:
    """Return the unit vector t_a_b that solves ``x_a^T [t]_x R x_b = 0`` in least squares.

    The constraint is linear, ``t^T (R x_b x x_a) = 0``; of the two signs the one that puts more
    points in front of both cameras is taken.

    Parameters
    ----------
    R_a_b : (3, 3) ndarray
    x_a, x_b : (M, 3) ndarray
        Corresponding points on the planes z = 1 of the two cameras, M >= 2.
    """
    b_a = _unit(x_a)
    b_b = _unit(x_b) @ R_a_b.T
    normals = np.cross(b_b, b_a)
    t: Float64Array = np.linalg.svd(normals, full_matrices=False)[2][-1]
    return t if _ahead(b_a, b_b, t) >= _ahead(b_a, b_b, -t) else -t


def _ahead(b_a: Float64Array, b_b: Float64Array, t: Float64Array) -> int:
    """Count the points ``d_a b_a = d_b b_b + t`` with positive depths in both cameras."""
    cosine = (b_a * b_b).sum(-1)
    along_a, along_b = b_a @ t, b_b @ t
    depth_a = along_a - cosine * along_b
    depth_b = cosine * along_a - along_b
    return int(((depth_a > 0) & (depth_b > 0)).sum())


def _unit(v: Float64Array) -> Float64Array:
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))
