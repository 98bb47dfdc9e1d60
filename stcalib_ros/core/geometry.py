"""Rotations, lenses, triangulation: pure functions on arrays."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from stcalib_ros.core.types import BoolArray, FloatArray, Intrinsics, LensModel

_MAX_TANGENT = 6.0
"""Bearings beyond about 80 degrees off the axis have no useful image on the plane z = 1."""
_NEARLY_HALF_TURN = -1.8
"""Twice the cosine of angles whose axis cannot be read from the skew part of the matrix."""


def exp_so3(omega: FloatArray) -> FloatArray:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3), rad (Rodrigues)."""
    omega = np.asarray(omega, dtype=np.float64)
    angle = np.sqrt((omega**2).sum(-1))[..., None, None]
    K = hat(omega)
    half = np.sinc(angle / (2.0 * np.pi))
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * half**2 * (K @ K))


def log_so3(R: FloatArray) -> FloatArray:
    """Rotation vectors (..., 3), rad, of rotation matrices (..., 3, 3)."""
    skew, cosine2 = _skew(R), np.trace(R, axis1=-2, axis2=-1) - 1.0
    if (cosine2 < _NEARLY_HALF_TURN).any():
        flat = Rotation.from_matrix(np.reshape(R, (-1, 3, 3))).as_rotvec()
        return flat.reshape(*np.shape(R)[:-2], 3)
    sine2 = np.sqrt((skew**2).sum(-1))
    angle = np.arctan2(sine2, cosine2)
    return np.asarray(skew / (2.0 * np.sinc(angle / np.pi))[..., None])


def rotation_angle(R: FloatArray) -> FloatArray:
    """Riemannian distance of rotations (..., 3, 3) from the identity, rad."""
    sine2 = np.sqrt((_skew(R) ** 2).sum(-1))
    angle: FloatArray = np.arctan2(sine2, np.trace(R, axis1=-2, axis2=-1) - 1.0)
    return angle


def _skew(R: FloatArray) -> FloatArray:
    """Twice the sine of the angle along the axis (..., 3) of rotations (..., 3, 3)."""
    return np.stack(
        [
            R[..., 2, 1] - R[..., 1, 2],
            R[..., 0, 2] - R[..., 2, 0],
            R[..., 1, 0] - R[..., 0, 1],
        ],
        -1,
    )


def quaternion_from_matrix(R: FloatArray) -> FloatArray:
    """Unit quaternions (..., 4) in the order x, y, z, w with w >= 0."""
    flat = Rotation.from_matrix(np.reshape(R, (-1, 3, 3))).as_quat(canonical=True)
    return flat.reshape(*np.shape(R)[:-2], 4)


def matrix_from_quaternion(q: FloatArray) -> FloatArray:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4) in the order x, y, z, w."""
    flat = Rotation.from_quat(np.reshape(q, (-1, 4))).as_matrix()
    return flat.reshape(*np.shape(q)[:-1], 3, 3)


def hat(v: FloatArray) -> FloatArray:
    """Cross-product matrices (..., 3, 3) of vectors (..., 3)."""
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def best_rotation(S: FloatArray) -> FloatArray:
    """Rotations that maximise ``tr(R.T @ S)``: orthogonal Procrustes (Kabsch).

    Parameters
    ----------
    S : (..., 3, 3) ndarray
        Cross-covariance, the sum of ``v_a v_b.T``.

    Returns
    -------
    (..., 3, 3) ndarray
        ``R_a_b``, which turns the directions v_b onto the v_a.
    """
    U, _, Vt = np.linalg.svd(S)
    U = U.copy()
    U[..., :, 2] *= np.linalg.det(U @ Vt)[..., None]
    rotation: FloatArray = U @ Vt
    return rotation


def best_rotation_trace(S: FloatArray) -> FloatArray:
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
    trace: FloatArray = s[..., 0] + s[..., 1] + np.sign(np.linalg.det(S)) * s[..., 2]
    return trace


def project(points_cam: FloatArray, intrinsics: Intrinsics) -> FloatArray:
    """Pixels (..., 2) of points (..., 3) of the optical frame; NaN behind the camera."""
    points = np.asarray(points_cam, float).reshape(-1, 3) @ intrinsics.R_rect_cam.T
    pixels = np.full((len(points), 2), np.nan)
    ahead = points[:, 2] > 1e-6
    if ahead.any():
        pixels[ahead] = _distort(points[ahead], intrinsics)
    return pixels.reshape(*np.shape(points_cam)[:-1], 2)


def _distort(points: FloatArray, intrinsics: Intrinsics) -> FloatArray:
    zero = np.zeros(3)
    D = intrinsics.D if intrinsics.D.size else np.zeros(4)
    source = np.ascontiguousarray(points[:, None])
    if intrinsics.model is LensModel.EQUIDISTANT:
        pixels, _ = cv2.fisheye.projectPoints(source, zero, zero, intrinsics.K, D)
    else:
        pixels, _ = cv2.projectPoints(source, zero, zero, intrinsics.K, D)
    return np.asarray(pixels, float).reshape(-1, 2)


def bearings(pixels: FloatArray, intrinsics: Intrinsics) -> tuple[FloatArray, FloatArray]:
    """Undistorted image points on the plane z = 1 of the optical frame.

    Parameters
    ----------
    pixels : (..., 2) ndarray
        Image points, px; NaN where not seen.
    intrinsics : Intrinsics

    Returns
    -------
    x : (..., 2) ndarray
        Points on the plane z = 1; NaN where not seen or where the lens model has no inverse.
    focal : (...) ndarray
        Pixels per unit of `x` at that point: multiply residuals by it to have them in px.
    """
    shape = np.shape(pixels)[:-1]
    flat = np.asarray(pixels, float).reshape(-1, 2)
    x = np.full_like(flat, np.nan)
    focal = np.full(len(flat), np.nan)
    seen = np.isfinite(flat).all(-1)
    if seen.any():
        x[seen], focal[seen] = _invert_lens(flat[seen], intrinsics)
    return x.reshape(*shape, 2), focal.reshape(shape)


def _invert_lens(pixels: FloatArray, intrinsics: Intrinsics) -> tuple[FloatArray, FloatArray]:
    """Newton's method on the lens model, from OpenCV's own inverse; closed form without a lens."""
    if _is_pinhole(intrinsics):
        K = intrinsics.K
        rays = np.concatenate([pixels, np.ones((len(pixels), 1))], -1) @ np.linalg.inv(K).T
        focal = np.sqrt(abs(K[0, 0] * K[1, 1]))
        return rays[:, :2] / rays[:, 2:], np.full(len(pixels), focal)
    x = _first_inverse(pixels, intrinsics)
    for _ in range(3):
        image, J = _lens_jacobian(x, intrinsics)
        step = np.linalg.solve(J, (image - pixels)[..., None])[..., 0]
        x = np.where(np.isfinite(step), x - step, np.nan)
    image, J = _lens_jacobian(x, intrinsics)
    with np.errstate(invalid="ignore"):
        good = (np.abs(image - pixels).max(-1) < 0.01) & (np.abs(x).max(-1) < _MAX_TANGENT)
    x[~good] = np.nan
    return x, np.sqrt(np.abs(np.linalg.det(J)))


def _is_pinhole(intrinsics: Intrinsics) -> bool:
    return (
        intrinsics.model is not LensModel.EQUIDISTANT
        and not intrinsics.D.any()
        and np.array_equal(intrinsics.R_rect_cam, np.eye(3))
    )


def _first_inverse(pixels: FloatArray, intrinsics: Intrinsics) -> FloatArray:
    K, D = intrinsics.K, intrinsics.D if intrinsics.D.size else np.zeros(4)
    source = np.ascontiguousarray(pixels[:, None])
    if intrinsics.model is LensModel.EQUIDISTANT:
        rectified = cv2.fisheye.undistortPoints(source, K, D)
    else:
        rectified = cv2.undistortPoints(source, K, D)
    plane = np.asarray(rectified, float).reshape(-1, 2)
    rays = np.concatenate([plane, np.ones((len(plane), 1))], -1) @ intrinsics.R_rect_cam
    return rays[:, :2] / rays[:, 2:]


def _lens_jacobian(x: FloatArray, intrinsics: Intrinsics) -> tuple[FloatArray, FloatArray]:
    """Pixels of points on the plane z = 1, and their derivatives (N, 2, 2)."""
    step = 1e-6
    finite = np.asarray(np.isfinite(x).all(-1))
    rays = np.concatenate([np.where(finite[:, None], x, 0.0), np.ones((len(x), 1))], -1)
    columns = [
        (project(rays + step * e, intrinsics) - project(rays - step * e, intrinsics)) / (2 * step)
        for e in np.eye(3)[:2]
    ]
    J = np.stack(columns, -1)
    usable = finite & np.isfinite(J).all((-2, -1)) & (np.abs(np.linalg.det(np.nan_to_num(J))) > 1.0)
    image = np.where(usable[:, None], project(rays, intrinsics), np.nan)
    return image, np.where(usable[:, None, None], J, np.eye(2))


def triangulate(
    centres: FloatArray, rays: FloatArray, weights: FloatArray, *, refinements: int = 2
) -> tuple[FloatArray, BoolArray]:
    """Points nearest to several rays each, weighted by inverse distance (closed form, iterated).

    Parameters
    ----------
    centres : (..., C, 3) ndarray
        Camera centres.
    rays : (..., C, 3) ndarray
        Unit directions in the same frame; anything where the weight is 0.
    weights : (..., C) ndarray
        0 for a camera that does not see the point.
    refinements : int
        Times that the distances are used as weights.

    Returns
    -------
    X : (..., 3) ndarray
        NaN where fewer than two rays, or parallel ones only, are given.
    good : (...) ndarray of bool
        Where `X` is finite and ahead of every camera that sees it.
    """
    seen = weights > 0
    b = [np.where(seen, rays[..., i], 0.0) for i in range(3)]
    origin = [np.where(seen, centres[..., i], 0.0) for i in range(3)]
    along = sum(b[i] * origin[i] for i in range(3))
    enough = seen.sum(-1) >= 2
    w = weights
    for _ in range(1 + refinements):
        total = w.sum(-1)
        A = {(i, j): -(w * b[i] * b[j]).sum(-1) for i, j in _UPPER}
        for i in range(3):
            A[i, i] += total
        right = [(w * (origin[i] - along * b[i])).sum(-1) for i in range(3)]
        X, ok = _solve_symmetric(A, right)
        depth = sum(b[i] * (X[i][..., None] - origin[i]) for i in range(3))
        w = weights / np.maximum(depth, 1e-3) ** 2
    ahead = ((depth > 0) | ~seen).all(-1)
    good = ok & enough
    return np.where(good[..., None], np.stack(X, -1), np.nan), good & ahead


_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def _solve_symmetric(
    A: dict[tuple[int, int], FloatArray], b: list[FloatArray]
) -> tuple[list[FloatArray], BoolArray]:
    """Cramer's rule for many symmetric 3x3 systems at once, and whether each is regular."""
    c00 = A[1, 1] * A[2, 2] - A[1, 2] ** 2
    c01 = A[0, 2] * A[1, 2] - A[0, 1] * A[2, 2]
    c02 = A[0, 1] * A[1, 2] - A[0, 2] * A[1, 1]
    c11 = A[0, 0] * A[2, 2] - A[0, 2] ** 2
    c12 = A[0, 1] * A[0, 2] - A[0, 0] * A[1, 2]
    c22 = A[0, 0] * A[1, 1] - A[0, 1] ** 2
    det = A[0, 0] * c00 + A[0, 1] * c01 + A[0, 2] * c02
    trace = A[0, 0] + A[1, 1] + A[2, 2]
    ok = det > 1e-9 * np.maximum(trace, 1e-300) ** 3
    inverse = np.where(ok, 1.0, 0.0) / np.where(ok, det, 1.0)
    rows = ((c00, c01, c02), (c01, c11, c12), (c02, c12, c22))
    return [sum(c * x for c, x in zip(row, b, strict=True)) * inverse for row in rows], ok


def umeyama(source: FloatArray, target: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Similarity ``target ~ s R source + t`` of two point sets (N, 3) in least squares.

    Returns
    -------
    s : float
    R : (3, 3) ndarray
    t : (3,) ndarray
    """
    a, b = source.mean(0), target.mean(0)
    S = (target - b).T @ (source - a)
    R = best_rotation(S)
    spread = float(((source - a) ** 2).sum())
    s = float(np.trace(R.T @ S)) / spread if spread > 0 else 1.0
    return s, R, b - s * R @ a
