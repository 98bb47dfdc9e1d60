"""The group of rotations SO(3): exponential, logarithm, angle, quaternions."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from stcalib_ros.core.model.arrays import Float64Array

_NEARLY_HALF_TURN = -1.8
"""Twice the cosine of angles whose axis cannot be read from the skew part of the matrix."""


def exp_so3(omega: Float64Array) -> Float64Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3), rad (Rodrigues)."""
    omega = np.asarray(omega, dtype=np.float64)
    angle = np.sqrt((omega**2).sum(-1))[..., None, None]
    K = hat(omega)
    half = np.sinc(angle / (2.0 * np.pi))
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * half**2 * (K @ K))


def log_so3(R: Float64Array) -> Float64Array:
    """Rotation vectors (..., 3), rad, of rotation matrices (..., 3, 3)."""
    skew, cosine2 = _skew(R), np.trace(R, axis1=-2, axis2=-1) - 1.0
    if (cosine2 < _NEARLY_HALF_TURN).any():
        flat = Rotation.from_matrix(np.reshape(R, (-1, 3, 3))).as_rotvec()
        return flat.reshape(*np.shape(R)[:-2], 3)
    sine2 = np.sqrt((skew**2).sum(-1))
    angle = np.arctan2(sine2, cosine2)
    return np.asarray(skew / (2.0 * np.sinc(angle / np.pi))[..., None])


def rotation_angle(R: Float64Array) -> Float64Array:
    """Riemannian distance of rotations (..., 3, 3) from the identity, rad."""
    sine2 = np.sqrt((_skew(R) ** 2).sum(-1))
    angle: Float64Array = np.arctan2(sine2, np.trace(R, axis1=-2, axis2=-1) - 1.0)
    return angle


def _skew(R: Float64Array) -> Float64Array:
    """Twice the sine of the angle along the axis (..., 3) of rotations (..., 3, 3)."""
    return np.stack(
        [
            R[..., 2, 1] - R[..., 1, 2],
            R[..., 0, 2] - R[..., 2, 0],
            R[..., 1, 0] - R[..., 0, 1],
        ],
        -1,
    )


def quaternion_from_matrix(R: Float64Array) -> Float64Array:
    """Unit quaternions (..., 4) in the order x, y, z, w with w >= 0."""
    flat = Rotation.from_matrix(np.reshape(R, (-1, 3, 3))).as_quat(canonical=True)
    return flat.reshape(*np.shape(R)[:-2], 4)


def matrix_from_quaternion(q: Float64Array) -> Float64Array:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4) in the order x, y, z, w."""
    flat = Rotation.from_quat(np.reshape(q, (-1, 4))).as_matrix()
    return flat.reshape(*np.shape(q)[:-1], 3, 3)


def hat(v: Float64Array) -> Float64Array:
    """Cross-product matrices (..., 3, 3) of vectors (..., 3)."""
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out
