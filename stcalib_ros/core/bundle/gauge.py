"""The length that fixes the scale of an adjustment: the spread of the cameras.

That is the root mean square distance of their centres from the mean. It does not hang on single
cameras: the first two may stand at one place, as those of a stereo pair.
"""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array


def camera_centres(R_cam_ref: Float64Array, t_cam_ref: Float64Array) -> Float64Array:
    """Centres (C, 3) of cameras in the reference frame."""
    return np.asarray(0.0 - np.einsum("cji,cj->ci", R_cam_ref, t_cam_ref))


def spread(centres: Float64Array) -> float:
    """Root mean square distance of points (C, 3) from their mean."""
    return float(np.sqrt(((centres - centres.mean(0)) ** 2).sum(-1).mean()))


def spread_gradient(
    R_cam_ref: Float64Array, t_cam_ref: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Derivatives (C, 3), (C, 3) of the spread by rotations and translations of the cameras."""
    centres = camera_centres(R_cam_ref, t_cam_ref)
    outward = (centres - centres.mean(0)) / (len(centres) * max(spread(centres), 1e-30))
    in_camera = np.einsum("cij,cj->ci", R_cam_ref, outward)
    return np.cross(t_cam_ref, in_camera), -in_camera
