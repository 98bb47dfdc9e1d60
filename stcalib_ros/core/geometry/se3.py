"""The group of rigid motions SE(3): exponential, logarithm, adjoint.

References
----------
T. D. Barfoot, "State estimation for robotics", 2017, chapter 7.
"""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.geometry.so3 import exp_so3, hat, log_so3
from stcalib_ros.core.model.arrays import Float64Array

_SMALL_ANGLE = 1e-3
"""rad. Below it the inverse left Jacobian is taken from its series. Numerical: exact to 1e-13."""
_SERIES_ANGLE = 0.1
"""rad. Below it coefficients that divide by powers of the angle are taken from series.
Numerical."""


def inverse(T: Float64Array) -> Float64Array:
    """Inverse poses (..., 4, 4)."""
    out = np.zeros_like(T)
    R_t = np.swapaxes(T[..., :3, :3], -1, -2)
    out[..., :3, :3] = R_t
    out[..., :3, 3] = -np.einsum("...ij,...j->...i", R_t, T[..., :3, 3])
    out[..., 3, 3] = 1.0
    return out


def exp_se3(xi: Float64Array) -> Float64Array:
    """Poses (..., 4, 4) of twists (..., 6)."""
    rho, phi = xi[..., :3], xi[..., 3:]
    first, second, _, _ = _coefficients(phi)
    P = hat(phi)
    V = np.eye(3) + first * P + second * (P @ P)
    T = np.zeros((*xi.shape[:-1], 4, 4))
    T[..., :3, :3] = exp_so3(phi)
    T[..., :3, 3] = np.einsum("...ij,...j->...i", V, rho)
    T[..., 3, 3] = 1.0
    return T


def log_se3(T: Float64Array) -> Float64Array:
    """Twists (..., 6) of poses (..., 4, 4)."""
    phi = log_so3(T[..., :3, :3])
    rho = np.einsum("...ij,...j->...i", _left_jacobian_inverse(phi), T[..., :3, 3])
    return np.concatenate([rho, phi], -1)


def adjoint(T: Float64Array) -> Float64Array:
    """Matrices (..., 6, 6) with ``T exp(xi) T^-1 = exp(Ad xi)``."""
    R = T[..., :3, :3]
    out = np.zeros((*T.shape[:-2], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = R
    out[..., :3, 3:] = hat(T[..., :3, 3]) @ R
    return out


def right_jacobian_inverse(xi: Float64Array) -> Float64Array:
    """Derivative (..., 6, 6) of ``log(exp(xi) exp(d))`` by d at zero (Barfoot, 7.95)."""
    inverse_block = _left_jacobian_inverse(-xi[..., 3:])
    out = np.zeros((*xi.shape[:-1], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = inverse_block
    out[..., :3, 3:] = -inverse_block @ _coupling(-xi) @ inverse_block
    return out


def _left_jacobian_inverse(phi: Float64Array) -> Float64Array:
    theta = np.linalg.norm(phi, axis=-1)[..., None, None]
    small = theta < _SMALL_ANGLE
    safe = np.where(small, 1.0, theta)
    second = np.where(small, 1.0 / 12.0, (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)
    P = hat(phi)
    return np.asarray(np.eye(3) - 0.5 * P + second * (P @ P))


def _coupling(xi: Float64Array) -> Float64Array:
    """Off-diagonal block (..., 3, 3) of the left Jacobian of SE(3) (Barfoot, 7.86b)."""
    rho, phi = hat(xi[..., :3]), hat(xi[..., 3:])
    _, c1, c2, c3 = _coefficients(xi[..., 3:])
    prp = phi @ rho @ phi
    return np.asarray(
        0.5 * rho
        + c1 * (phi @ rho + rho @ phi + prp)
        + c2 * (phi @ phi @ rho + rho @ phi @ phi - 3.0 * prp)
        + c3 * (prp @ phi + phi @ prp)
    )


def _coefficients(
    phi: Float64Array,
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """(1 - cos) / t^2, (t - sin) / t^3, and the third and fourth of Barfoot's 7.86b."""
    t = np.linalg.norm(phi, axis=-1)[..., None, None]
    small = t < _SERIES_ANGLE
    s = np.where(small, 1.0, t)
    sine, cosine, t2 = np.sin(s), np.cos(s), t**2
    exact = (
        (1.0 - cosine) / s**2,
        (s - sine) / s**3,
        (0.5 * s**2 + cosine - 1.0) / s**4,
        0.5 * (2.0 * s - 3.0 * sine + s * cosine) / s**5,
    )
    series = (
        0.5 - t2 / 24.0 + t2**2 / 720.0,
        1.0 / 6.0 - t2 / 120.0 + t2**2 / 5040.0,
        1.0 / 24.0 - t2 / 720.0 + t2**2 / 40320.0,
        1.0 / 120.0 - t2 / 2520.0 + t2**2 / 120960.0,
    )
    first, second, third, fourth = (
        np.where(small, b, a) for a, b in zip(exact, series, strict=True)
    )
    return first, second, third, fourth
