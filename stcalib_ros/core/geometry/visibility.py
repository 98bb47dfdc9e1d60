"""Which points of space a camera images."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import Intrinsics, LensModel

_MIN_DEPTH = 0.05
"""Metres. Points closer to the plane of the camera, or behind it, have no image. Chosen: below the
focusing distance of any camera."""

_HALF_PIXEL = 0.5
"""Pixels. Pixel centres have whole coordinates, so that the image begins at -0.5."""

_MAX_RADIUS, _N_RADII = 4.0, 801
"""Range (plane z = 1, 76 degrees off the axis) and number of radii at which a distortion model is
checked. Purely numerical: steps of 0.005 are finer than a distortion polynomial bends."""


def project_visible(points_cam: Float64Array, lens: Intrinsics) -> Float64Array:
    """Project points (..., 3) of the optical frame to pixels (..., 2); NaN outside the image.

    Points outside of the domain of the distortion model, where it leads back into the image, are
    outside the image as well.

    Parameters
    ----------
    points_cam : (..., 3) ndarray
        Points in the optical frame, metres.
    lens : Intrinsics
    """
    depth = points_cam[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.hypot(points_cam[..., 0], points_cam[..., 1]) / depth
    pixels = project(points_cam, lens)
    limit = np.array([lens.width, lens.height]) - _HALF_PIXEL
    with np.errstate(invalid="ignore"):
        inside = np.all((pixels >= -_HALF_PIXEL) & (pixels < limit), axis=-1)
    pixels[~(inside & (depth > _MIN_DEPTH) & (radius < _domain_radius(lens)))] = np.nan
    return pixels


def _domain_radius(lens: Intrinsics) -> float:
    """Return the distance from the axis at depth 1 up to which the distorted radius grows."""
    if lens.model is LensModel.EQUIDISTANT or not np.any(lens.D):
        return np.inf
    r = np.linspace(0, _MAX_RADIUS, _N_RADII)
    r2 = r**2
    d = np.zeros(8)
    d[: min(8, len(lens.D))] = lens.D[:8]
    with np.errstate(divide="ignore", invalid="ignore"):
        growth = (1 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]))) / (
            1 + r2 * (d[5] + r2 * (d[6] + r2 * d[7]))
        )
    falling = np.flatnonzero(np.diff(r * growth) <= 0)
    return float(r[falling[0]]) if len(falling) else np.inf
