"""Errors of estimated lenses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.geometry.alignment import best_rotation
from stcalib_ros.core.geometry.lens import bearings
from stcalib_ros.core.geometry.triangulation import unit_rays
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import CameraCalibration
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.recording import Intrinsics

_GRID = 17
"""Points of the image along each side at which rays are compared. Numerical: rays of lenses differ
smoothly over the image."""
_RADIAL = 2
"""Coefficients of radial distortion that are compared, k1 and k2: those that can be estimated."""
_NO_RADIAL = np.full(_RADIAL, np.nan)


@dataclass(frozen=True, slots=True)
class LensError:
    """Errors of the lens of one camera: estimate minus truth.

    Attributes
    ----------
    name : str
    estimated : bool
        By the calibration; else it was given.
    focal : float
        Of the focal length, relative to the true one.
    principal_point_px : float
        Distance from the true principal point.
    radial : tuple of float
        Of k1 and k2; NaN where the models differ.
    ray_rad : float
        Root mean square angle between the rays of the same pixel over the image, after the rotation
        that makes it smallest; whatever the models. NaN where they have no rays in common.
    """

    name: str
    estimated: bool
    focal: float
    principal_point_px: float
    radial: tuple[float, ...]
    ray_rad: float


def lens_error(found: CameraCalibration, true: CameraCalibration) -> LensError:
    """Compare the lens of a camera with the true one."""
    ours, right = found.intrinsics, true.intrinsics
    radial = _radial(ours) - _radial(right) if ours.model is right.model else _NO_RADIAL
    return LensError(
        true.name,
        found.lens_knowledge is not LensKnowledge.GIVEN,
        focal=_focal_px(ours) / _focal_px(right) - 1.0,
        principal_point_px=float(np.linalg.norm(ours.K[:2, 2] - right.K[:2, 2])),
        radial=tuple(map(float, radial)),
        ray_rad=ray_alignment(ours, right)[1],
    )


def _focal_px(lens: Intrinsics) -> float:
    return float(np.sqrt(np.abs(lens.K[0, 0] * lens.K[1, 1])))


def _radial(lens: Intrinsics) -> Float64Array:
    """Return k1 and k2, which come first in every model; 0 where there is no such coefficient."""
    return np.pad(lens.D[:_RADIAL], (0, max(0, _RADIAL - len(lens.D))))


def ray_alignment(estimate: Intrinsics, truth: Intrinsics) -> tuple[Float64Array, float]:
    """Align the rays of the same pixels of two lenses.

    Returns
    -------
    R_true_found : (3, 3) ndarray
        Rotation that turns the rays of the estimate onto the true ones; a principal point that is
        off is mostly a rotation. The identity where there are no rays in common.
    rms_rad : float
        Root mean square angle that is left; NaN where there are none.
    """
    u, v = np.meshgrid(*(np.linspace(0, n - 1, _GRID) for n in (truth.width, truth.height)))
    pixels = np.stack([u.ravel(), v.ravel()], -1)
    ours, right = (unit_rays(bearings(pixels, lens)[0]) for lens in (estimate, truth))
    both = np.isfinite(ours).all(-1) & np.isfinite(right).all(-1)
    if not both.any():
        return np.eye(3), float("nan")
    ours, right = ours[both], right[both]
    R_true_found = best_rotation(right.T @ ours)
    left = ours @ R_true_found.T - right
    return R_true_found, float(np.sqrt((left**2).sum(-1).mean()))
