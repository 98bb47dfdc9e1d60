"""Rotations and similarities that align point sets."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array


def unit(v: Float64Array) -> Float64Array:
    """Return the direction (3,) of a vector (3,); zero for a zero vector."""
    return np.asarray(v / max(float(np.sqrt(v @ v)), 1e-12))


def best_rotation(S: Float64Array) -> Float64Array:
    """Return the rotations that maximize ``tr(R.T @ S)`` (orthogonal Procrustes problem).

    Parameters
    ----------
    S : (..., 3, 3) ndarray
        Cross-covariance, the sum of ``v_a v_b.T``.

    Returns
    -------
    (..., 3, 3) ndarray
        ``R_a_b``, which rotates the directions v_b onto the v_a.

    References
    ----------
    W. Kabsch, "A solution for the best rotation to relate two sets of vectors", 1976.
    """
    U, _, Vt = np.linalg.svd(S)
    U = U.copy()
    U[..., :, 2] *= np.linalg.det(U @ Vt)[..., None]
    rotation: Float64Array = U @ Vt
    return rotation


def best_rotation_trace(S: Float64Array) -> Float64Array:
    """Value ``max_R tr(R.T @ S)`` without the rotation: closed form, for very many matrices.

    The singular values come from the characteristic polynomial of ``S.T @ S``; the smallest
    one is subtracted where ``det S < 0``.
    """
    S = np.asarray(S, float)
    M = np.swapaxes(S, -1, -2) @ S
    mean = np.trace(M, axis1=-2, axis2=-1) / 3.0
    B = M - mean[..., None, None] * np.eye(3)
    spread = np.sqrt(np.maximum(np.einsum("...ij,...ij->...", B, B) / 6.0, 1e-300))
    half_det = np.clip(np.linalg.det(B / spread[..., None, None]) / 2.0, -1.0, 1.0)
    phi = np.arccos(half_det) / 3.0
    largest = mean + 2.0 * spread * np.cos(phi)
    smallest = mean + 2.0 * spread * np.cos(phi + 2.0 * np.pi / 3.0)
    middle = 3.0 * mean - largest - smallest
    s = np.sqrt(np.maximum(np.stack([largest, middle, smallest], -1), 0.0))
    trace: Float64Array = s[..., 0] + s[..., 1] + np.sign(np.linalg.det(S)) * s[..., 2]
    return trace


def umeyama(source: Float64Array, target: Float64Array) -> tuple[float, Float64Array, Float64Array]:
    """Similarity ``target ~ s R source + t`` of two point sets (N, 3) in least squares.

    Returns
    -------
    s : float
    R : (3, 3) ndarray
    t : (3,) ndarray

    References
    ----------
    S. Umeyama, "Least-squares estimation of transformation parameters between two point
    patterns", 1991.
    """
    a, b = source.mean(0), target.mean(0)
    S = (target - b).T @ (source - a)
    R = best_rotation(S)
    spread = float(((source - a) ** 2).sum())
    s = float(np.trace(R.T @ S)) / spread if spread > 0 else 1.0
    return s, R, b - s * R @ a
