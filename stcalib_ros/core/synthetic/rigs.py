"""Simulated cameras: a random ring, or a rig that is given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import Intrinsics, LensModel

_HIP_HEIGHT = 0.95
"""Metres. Height of the hips of an adult, at which the cameras of a ring look."""

DISTORTION_TERMS = {
    LensModel.PLUMB_BOB: 5,
    LensModel.RATIONAL_POLYNOMIAL: 8,
    LensModel.EQUIDISTANT: 4,
}
"""Number of coefficients of each lens model in OpenCV."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneRig:
    """Cameras in a world.

    Attributes
    ----------
    names : tuple of str
    intrinsics : tuple of Intrinsics
    R_cam_world : (C, 3, 3) ndarray
    t_cam_world : (C, 3) ndarray
        ``x_cam = R_cam_world @ x_world + t_cam_world``, metres.
    """

    names: tuple[str, ...]
    intrinsics: tuple[Intrinsics, ...]
    R_cam_world: Float64Array
    t_cam_world: Float64Array

    def __post_init__(self) -> None:
        n = len(self.names)
        if len(set(self.names)) != n:
            raise InputError(f"rig: camera names given twice: {', '.join(self.names)}")
        if len(self.intrinsics) != n:
            raise InputError(f"rig: {n} names but {len(self.intrinsics)} intrinsics")
        if self.R_cam_world.shape != (n, 3, 3) or self.t_cam_world.shape != (n, 3):
            raise InputError(
                f"rig: expected R of shape ({n}, 3, 3) and t of shape ({n}, 3), got "
                f"{self.R_cam_world.shape} and {self.t_cam_world.shape}"
            )

    @property
    def centres_world(self) -> Float64Array:
        """Camera centres (C, 3)."""
        centres: Float64Array = -np.einsum("cba,cb->ca", self.R_cam_world, self.t_cam_world)
        return centres


def ring_rig(
    rng: np.random.Generator,
    n_cameras: int,
    *,
    image_size: tuple[int, int],
    focal_px: float | tuple[float, ...],
    radius_m: tuple[float, float],
    height_m: tuple[float, float],
    model: LensModel = LensModel.PLUMB_BOB,
    distortion: tuple[float, ...] = (),
    principal_point_px: float = 0.0,
) -> SceneRig:
    """Place cameras around the origin that look at its surroundings; z is up, the floor at 0."""
    even = np.arange(n_cameras) / n_cameras
    angle = 2 * np.pi * (even + rng.uniform() + rng.uniform(-0.25, 0.25, n_cameras) / n_cameras)
    radius, height = rng.uniform(*radius_m, n_cameras), rng.uniform(*height_m, n_cameras)
    centre = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)
    target = np.array([0.0, 0.0, _HIP_HEIGHT]) + 0.15 * rng.standard_normal((n_cameras, 3))
    R = np.stack([_looking(a, b) for a, b in zip(centre, target, strict=True)])
    D = np.pad(distortion, (0, DISTORTION_TERMS[model] - len(distortion)))
    at = 0.5 * np.array(image_size) + np.zeros((n_cameras, 2))
    if principal_point_px:
        at += principal_point_px * rng.standard_normal((n_cameras, 2))
    focal = np.broadcast_to(focal_px, n_cameras)
    return SceneRig(
        tuple(f"cam{c}" for c in range(n_cameras)),
        tuple(_lens(image_size, float(f), c, model, D) for f, c in zip(focal, at, strict=True)),
        R,
        -np.einsum("cab,cb->ca", R, centre),
    )


def _lens(
    image_size: tuple[int, int],
    focal_px: float,
    principal_point_px: Float64Array,
    model: LensModel,
    D: Float64Array,
) -> Intrinsics:
    """Return a lens of square pixels."""
    cx, cy = principal_point_px
    K = np.array([[focal_px, 0, cx], [0, focal_px, cy], [0, 0, 1.0]])
    return Intrinsics(*image_size, model, K, D)


def staged(rig: SceneRig, *, scale: float = 1.0) -> SceneRig:
    """Place a given rig in a world with z up and its origin on the floor amid the views.

    The middle is the point nearest to all optical axes, taken as hip height; up is the mean of
    the cameras' upward axes.

    Parameters
    ----------
    rig : SceneRig
    scale : float
        Factor of the distances between the cameras.
    """
    centres = scale * rig.centres_world
    axes = rig.R_cam_world[:, 2]
    off_axis = np.eye(3) - axes[:, :, None] * axes[:, None]
    middle = np.linalg.lstsq(off_axis.sum(0), np.einsum("cab,cb->a", off_axis, centres), rcond=None)
    up = -rig.R_cam_world[:, 1].mean(axis=0)
    up = up / np.linalg.norm(up)
    side = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    side = side / np.linalg.norm(side)
    R_stage_world = np.stack([side, np.cross(up, side), up])
    R = rig.R_cam_world @ R_stage_world.T
    local = (centres - middle[0]) @ R_stage_world.T + [0.0, 0.0, _HIP_HEIGHT]
    return SceneRig(rig.names, rig.intrinsics, R, -np.einsum("cab,cb->ca", R, local))


def _looking(centre: Float64Array, target: Float64Array) -> Float64Array:
    """Return R_cam_world of a camera that looks from one point to another, level."""
    ahead = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right = right / np.linalg.norm(right)
    return np.stack([right, np.cross(ahead, right), ahead])
