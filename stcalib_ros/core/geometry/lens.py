"""Lens models: from points in a camera to pixels and back."""

from __future__ import annotations

import cv2
import numpy as np

from stcalib_ros.core.geometry.radial import LEAST_SLOPE, is_radial, radial_profile
from stcalib_ros.core.model.arrays import Float64Array, FloatArray
from stcalib_ros.core.model.recording import Intrinsics, LensModel

_MIN_DEPTH = 1e-6
"""Units of length. Points closer to the plane of the camera have no image. Numerical."""
_MAX_TANGENT = 6.0
"""Units of the plane z = 1. Bearings beyond, 80 degrees off the axis, have no useful image on it.
Chosen."""
_MAX_RESIDUAL_PX = 0.01
"""Pixels. An inverse of the lens model that misses the keypoint by more has not converged.
Numerical."""
_NEWTON_STEPS = 3
"""Newton steps on the lens model, from OpenCV's own inverse. Numerical: two are enough."""
_RADIAL_STEPS = 12
"""Newton steps on radial distortion, from none. Numerical: four for a usual lens."""


def project(points_cam: Float64Array, intrinsics: Intrinsics) -> Float64Array:
    """Pixels (..., 2) of points (..., 3) of the optical frame; NaN behind the camera."""
    points = np.asarray(points_cam, float).reshape(-1, 3) @ intrinsics.R_rect_cam.T
    pixels = np.full((len(points), 2), np.nan)
    ahead = points[:, 2] > _MIN_DEPTH
    if ahead.any():
        pixels[ahead] = _distort(points[ahead], intrinsics)
    return pixels.reshape(*np.shape(points_cam)[:-1], 2)


def project_plane(x: Float64Array, intrinsics: Intrinsics) -> Float64Array:
    """Pixels (..., 2) of points (..., 2) on the plane z = 1 of the optical frame; NaN of NaN."""
    return project(np.concatenate([x, np.ones((*x.shape[:-1], 1))], -1), intrinsics)


def _distort(points: Float64Array, intrinsics: Intrinsics) -> Float64Array:
    zero = np.zeros(3)
    D = intrinsics.D if intrinsics.D.size else np.zeros(4)
    source = np.ascontiguousarray(points[:, None])
    if intrinsics.model is LensModel.EQUIDISTANT:
        pixels, _ = cv2.fisheye.projectPoints(source, zero, zero, intrinsics.K, D)
    else:
        pixels, _ = cv2.projectPoints(source, zero, zero, intrinsics.K, D)
    return np.asarray(pixels, float).reshape(-1, 2)


def bearings(pixels: FloatArray, intrinsics: Intrinsics) -> tuple[Float64Array, Float64Array]:
    """Undistorted image points on the plane z = 1 of the optical frame.

    Parameters
    ----------
    pixels : (..., 2) ndarray
        Image points, px; NaN where not observed.
    intrinsics : Intrinsics

    Returns
    -------
    x : (..., 2) ndarray
        Points on the plane z = 1; NaN where not observed or where the lens model has no inverse.
    focal : (...) ndarray
        Pixels per unit of `x` at that point: multiply residuals by it to have them in px.
    """
    shape = np.shape(pixels)[:-1]
    flat = np.asarray(pixels, float).reshape(-1, 2)
    x = np.full_like(flat, np.nan)
    focal = np.full(len(flat), np.nan)
    observed = np.isfinite(flat).all(-1)
    if observed.any():
        x[observed], focal[observed] = _invert_lens(flat[observed], intrinsics)
    return x.reshape(*shape, 2), focal.reshape(shape)


def _invert_lens(pixels: Float64Array, intrinsics: Intrinsics) -> tuple[Float64Array, Float64Array]:
    """Newton's method on the lens model; closed form without a lens, by the radius if radial."""
    if _is_pinhole(intrinsics):
        K = intrinsics.K
        rays = np.concatenate([pixels, np.ones((len(pixels), 1))], -1) @ np.linalg.inv(K).T
        focal = np.sqrt(abs(K[0, 0] * K[1, 1]))
        return rays[:, :2] / rays[:, 2:], np.full(len(pixels), focal)
    if is_radial(intrinsics):
        return _invert_radial(pixels, intrinsics)
    x = _first_inverse(pixels, intrinsics)
    for _ in range(_NEWTON_STEPS):
        image, J = _lens_jacobian(x, intrinsics)
        step = np.linalg.solve(J, (image - pixels)[..., None])[..., 0]
        x = np.where(np.isfinite(step), x - step, np.nan)
    image, J = _lens_jacobian(x, intrinsics)
    with np.errstate(invalid="ignore"):
        good = (np.abs(image - pixels).max(-1) < _MAX_RESIDUAL_PX) & (
            np.abs(x).max(-1) < _MAX_TANGENT
        )
    x[~good] = np.nan
    return x, np.sqrt(np.abs(np.linalg.det(J)))


def _invert_radial(
    pixels: Float64Array, intrinsics: Intrinsics
) -> tuple[Float64Array, Float64Array]:
    profile, f = radial_profile([intrinsics]), np.diag(intrinsics.K)[:2]
    image = (pixels - intrinsics.K[:2, 2]) / f
    d = np.linalg.norm(image, axis=-1)
    at = profile.at(profile.inverse(d[None], steps=_RADIAL_STEPS))
    gain, slope = at.gain[0], at.slope[0]
    x = image / gain[:, None]
    missed = np.abs(at.gain[0] * at.r[0] - d) * f.max()
    good = (missed < _MAX_RESIDUAL_PX) & (slope > LEAST_SLOPE) & (np.abs(x).max(-1) < _MAX_TANGENT)
    x[~good] = np.nan
    return x, np.sqrt(np.abs(f.prod() * gain * slope))


def change_lens(
    x: Float64Array, before: Intrinsics, after: Intrinsics
) -> tuple[Float64Array, Float64Array]:
    """Undistort image points by another lens.

    Parameters
    ----------
    x : (..., 2) ndarray
        Points on the plane z = 1, undistorted by `before`; NaN where not observed.
    before, after : Intrinsics

    Returns
    -------
    x : (..., 2) ndarray
    focal : (...) ndarray
        As by `bearings`.
    """
    return bearings(project_plane(x, before), after)


def _is_pinhole(intrinsics: Intrinsics) -> bool:
    return (
        intrinsics.model is not LensModel.EQUIDISTANT
        and not intrinsics.D.any()
        and np.array_equal(intrinsics.R_rect_cam, np.eye(3))
    )


def _first_inverse(pixels: Float64Array, intrinsics: Intrinsics) -> Float64Array:
    K, D = intrinsics.K, intrinsics.D if intrinsics.D.size else np.zeros(4)
    source = np.ascontiguousarray(pixels[:, None])
    if intrinsics.model is LensModel.EQUIDISTANT:
        rectified = cv2.fisheye.undistortPoints(source, K, D)
    else:
        rectified = cv2.undistortPoints(source, K, D)
    plane = np.asarray(rectified, float).reshape(-1, 2)
    rays = np.concatenate([plane, np.ones((len(plane), 1))], -1) @ intrinsics.R_rect_cam
    return rays[:, :2] / rays[:, 2:]


def _lens_jacobian(x: Float64Array, intrinsics: Intrinsics) -> tuple[Float64Array, Float64Array]:
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
