"""Normal equations of cameras and key point biases, the joint positions eliminated.

The bias of one joint of one person touches only the image points of that joint: after the
positions it is eliminated, joint by joint, which leaves a small dense system of the cameras.
Arrays are over (..., joint, row), rows last.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.bundle.normal_equations import (
    CAMERA,
    NEAREST,
    Cameras,
    backward_solve,
    cholesky3,
    forward_solve,
)
from stcalib_ros.core.model.arrays import BoolArray, Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Image points of one person in some rows.

    Attributes
    ----------
    person : int
        Position among the biases.
    rows : slice
        Of the observations.
    x : (C, 2, J, n) ndarray
    focal : (C, J, n) ndarray
        0 where an image point does not take part.
    phi : (C, J, n) or (C, 1, n) ndarray
        Time of the image point after the knot, s.
    V, A : (3, J, n) ndarray
        Velocities and accelerations.
    R_ref_body : (3, 3, n) ndarray
    basis : (C, B, n) ndarray
        Harmonics of the direction to the cameras.
    """

    person: int
    rows: slice
    x: Float64Array
    focal: Float64Array
    phi: Float64Array
    V: Float64Array
    A: Float64Array
    R_ref_body: Float64Array
    basis: Float64Array

    def displacement(self, camera: int, bias: Float64Array) -> Float64Array:
        """Displacements (3, J, n), reference frame, of key points with coefficients (J, 3, B)."""
        in_body = bias @ self.basis[camera]
        R = self.R_ref_body[:, :, None]
        return np.asarray(sum(R[:, b] * in_body[:, b] for b in range(3)))


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """One camera's residuals and what they depend on, weighted.

    Attributes
    ----------
    squared : (J, n) ndarray
        Square of the residuals, px, not weighted; infinite behind the camera.
    r : (2, J, n) ndarray
    A : (2, 3, J, n) ndarray
        Derivative by the joint in the reference frame.
    rows : (2, 3, J, n) ndarray
        Derivative by the joint in the camera's frame.
    y, velocity : (3, J, n) ndarray
        Joint and its velocity, turned into the camera's axes.
    """

    squared: Float64Array
    r: Float64Array
    A: Float64Array
    rows: Float64Array
    y: Float64Array
    velocity: Float64Array


def look(
    part: Part, c: int, cameras: Cameras, X: Float64Array, bias: Float64Array, scale: float
) -> Seen:
    """Project joints X (3, J, n) with biases (J, 3, B) into a camera; Cauchy weights of a scale."""
    R = cameras.R[c]
    when = part.phi[c] + cameras.shift[c]
    place = X + when * (part.V + 0.5 * when * part.A) + part.displacement(c, bias)
    y = np.tensordot(R, place, 1)
    velocity = np.tensordot(R, part.V + when * part.A, 1)
    Z = y + cameras.t[c][:, None, None]
    ahead = Z[2] > NEAREST
    inverse = 1.0 / np.where(ahead, Z[2], 1.0)
    u = Z[:2] * inverse
    r = (u - part.x[c]) * part.focal[c]
    squared = r[0] ** 2 + r[1] ** 2
    root = np.sqrt(ahead / (1.0 + squared / scale**2))
    gain = part.focal[c] * inverse * root
    rows = np.zeros((2, 3, *gain.shape))
    rows[0, 0], rows[1, 1] = gain, gain
    rows[0, 2], rows[1, 2] = -gain * u[0], -gain * u[1]
    A = np.empty_like(rows)
    for i in range(2):
        A[i] = rows[i, i] * R[i][:, None, None] + rows[i, 2] * R[2][:, None, None]
    seen = part.focal[c] > 0.0
    squared = np.where(seen & ~ahead, np.inf, squared)
    return Seen(squared, r * root, A, rows, y, velocity)


def follow(
    part: Part, cameras: Cameras, X: Float64Array, bias: Float64Array, scale: float, steps: int
) -> Float64Array:
    """Joints (3, J, n) after Gauss-Newton steps of their own, cameras and biases given."""
    for _ in range(steps):
        H, g = np.zeros((3, 3, *X.shape[1:])), np.zeros(X.shape)
        for c in range(len(cameras.t)):
            s = look(part, c, cameras, X, bias, scale)
            H += _squared(s.A)
            g += (s.A * s.r[:, None]).sum(0)
        factors = cholesky3(H, 0.0)
        X = X - backward_solve(factors, forward_solve(factors, g)) * _twice_seen(part)
    return X


def person_sums(
    part: Part, cameras: Cameras, X: Float64Array, bias: Float64Array, scale: float
) -> Float64Array:
    """Normal equations (J, q, q) of 7 C camera unknowns, 3 B biases and the right side.

    The joint positions X (3, J, n) are eliminated.
    """
    C, (J, n) = len(cameras.t), X.shape[1:]
    B = part.basis.shape[1]
    k = CAMERA * C
    q = k + 3 * B + 1
    H, W = np.zeros((3, 3, J, n)), np.zeros((3, q, J, n))
    S = np.zeros((J, q, q))
    for c in range(C):
        s = look(part, c, cameras, X, bias, scale)
        F = _columns(part, c, s)
        index = np.r_[CAMERA * c : CAMERA * (c + 1), k:q]
        flat = F.reshape(J, len(index), 2 * n)
        S[:, index[:, None], index] += flat @ flat.swapaxes(1, 2)
        H += _squared(s.A)
        for i in range(2):
            f = F[:, :, i].swapaxes(0, 1)
            for a in range(3):
                product = f * s.A[i, a]
                W[a, CAMERA * c : CAMERA * (c + 1)] += product[:CAMERA]
                W[a, k:] += product[CAMERA:]
    W = forward_solve(cholesky3(H, 0.0), W)
    T = W.transpose(2, 1, 0, 3).reshape(J, q, 3 * n)
    return np.asarray(S - T @ T.swapaxes(1, 2))


def _columns(part: Part, c: int, s: Seen) -> Float64Array:
    """Weighted derivatives (J, 7 + 3 B + 1, 2, n) by camera and biases, and the residuals."""
    J, n = s.squared.shape
    B = part.basis.shape[1]
    F = np.empty((J, CAMERA + 3 * B + 1, 2, n))
    for i in range(2):
        a = s.rows[i]
        F[:, :3, i] = np.cross(s.y, a, axis=0).swapaxes(0, 1)
        F[:, 3:6, i] = a.swapaxes(0, 1)
        F[:, 6, i] = (a * s.velocity).sum(0)
        in_body = sum(s.A[i, b][:, None] * part.R_ref_body[b] for b in range(3))
        F[:, CAMERA:-1, i] = (in_body[:, :, None] * part.basis[c]).reshape(J, 3 * B, n)
        F[:, -1, i] = s.r[i]
    return F


def _squared(A: Float64Array) -> Float64Array:
    """``A^T A`` (3, 3, J, n) of A (2, 3, J, n)."""
    return np.asarray(sum(a[:, None] * a[None] for a in A))


def _twice_seen(part: Part) -> BoolArray:
    """Joints (J, n) that two cameras or more see."""
    return np.asarray((part.focal > 0.0).sum(0) >= 2)
