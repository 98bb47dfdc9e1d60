"""CameraInfo that contradicts itself, or the places of the keypoints in the image."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.lifting.keypoint_checks import full_poses
from stcalib_ros.core.lifting.limits import (
    EXPLAINED_OFF_CENTRE,
    FILLS_CORNER,
    FISHEYE_DEG,
    IN_CORNER,
    MAX_OFF_CENTRE,
    MAX_OUTSIDE,
    MAX_PIXEL_RATIO,
    MIN_POSES_PLACED,
    NEAR_CENTRE,
    OUTSIDE_MARGIN,
    VIEW_RANGE_DEG,
)
from stcalib_ros.core.model.arrays import Float64Array, FloatArray
from stcalib_ros.core.model.recording import Intrinsics, LensModel, Recording
from stcalib_ros.core.model.rejection import Rejection, RejectionReason

_EXTREME = 0.001
"""Fraction of the poses, at either end, that do not count for where all of them are: outliers of
detectors. Chosen."""


def intrinsics_faults(recording: Recording, *, min_score: float) -> dict[str, Rejection]:
    """Return why the lens of a camera cannot be that of its keypoints, by the camera's name.

    Parameters
    ----------
    recording : Recording
    min_score : float
        Joints with a lower score are not looked at.
    """
    faults = {}
    for camera in recording.cameras:
        lens = camera.intrinsics
        found = focal_length_fault(lens) or principal_point_fault(lens)
        found = found or placement_fault(lens, full_poses(camera, min_score))
        if found is not None:
            reason, measured, limit, values = found
            size = {"width": float(lens.width), "height": float(lens.height)}
            faults[camera.name] = Rejection(
                reason, (camera.name,), measured, limit, values=size | values
            )
    return faults


Fault = tuple[RejectionReason, float, float, dict[str, float]]
"""Reason, measured value and limit of a fault, and further numbers."""


def focal_length_fault(lens: Intrinsics) -> Fault | None:
    """Return what is absurd about the focal lengths of a lens.

    Parameters
    ----------
    lens : Intrinsics
    """
    focal, size = np.diag(lens.K)[:2], sensor_rectangle(lens)[2:]
    if lens.model is LensModel.EQUIDISTANT:
        view, most = np.degrees(size / focal), FISHEYE_DEG
    else:
        view, most = np.degrees(2.0 * np.arctan(0.5 * size / focal)), VIEW_RANGE_DEG[1]
    ratio = float(focal[1] / focal[0])
    values = {"fx": focal[0], "fy": focal[1], "fov_x": view[0], "fov_y": view[1], "ratio": ratio}
    values = {name: float(value) for name, value in values.items()}
    widest = float(view.max())
    reason = RejectionReason.FOCAL_LENGTH_ABSURD
    if widest > most:
        return reason, widest, most, values
    if widest < VIEW_RANGE_DEG[0]:
        return reason, widest, VIEW_RANGE_DEG[0], values
    if max(ratio, 1.0 / ratio) > MAX_PIXEL_RATIO:
        return reason, max(ratio, 1.0 / ratio), MAX_PIXEL_RATIO, values
    return None


def principal_point_fault(lens: Intrinsics) -> Fault | None:
    """Return how far the principal point of a lens is from the middle of its sensor, if too far.

    Parameters
    ----------
    lens : Intrinsics
    """
    left, top, width, height = sensor_rectangle(lens)
    size = np.array([width, height])
    point = lens.K[:2, 2] + 0.5 - [left, top]
    share = point / size
    off = float(np.abs(share - 0.5).max())
    exchanged = np.abs(point[::-1] / size - 0.5).max() < NEAR_CENTRE
    of_another_size = abs(share[0] - share[1]) < NEAR_CENTRE
    limit = EXPLAINED_OFF_CENTRE if exchanged or of_another_size else MAX_OFF_CENTRE
    if off <= limit:
        return None
    values = {"cx": float(lens.K[0, 2]), "cy": float(lens.K[1, 2])}
    return RejectionReason.PRINCIPAL_POINT_OFF_CENTRE, off, limit, values


def placement_fault(lens: Intrinsics, poses: FloatArray) -> Fault | None:
    """Return why poses cannot be in the image that a lens describes.

    Parameters
    ----------
    lens : Intrinsics
    poses : (N, J, 2) ndarray
        Keypoints, px; NaN where not observed.
    """
    if len(poses) < MIN_POSES_PLACED:
        return None
    size = np.array([lens.width, lens.height])
    margin = OUTSIDE_MARGIN * size
    out = ((poses < -margin) | (poses > size - 1 + margin)).any(-1).sum(-1)
    known = np.isfinite(poses[..., 0]).sum(-1)
    outside = float((2 * out > known).mean())
    low, high = np.fmin.reduce(poses, axis=1), np.fmax.reduce(poses, axis=1)
    least = np.quantile(low, _EXTREME, axis=0)
    most = np.quantile(high, 1.0 - _EXTREME, axis=0)
    values = {"most_x": float(most[0]), "most_y": float(most[1])}
    if outside > MAX_OUTSIDE:
        return RejectionReason.KEYPOINTS_OUTSIDE_IMAGE, outside, MAX_OUTSIDE, values
    part = float((most / size).max())
    fills = (most - least > FILLS_CORNER * np.maximum(most, 0.0)).all()
    if part < IN_CORNER and fills and (least > -margin).all():
        return RejectionReason.KEYPOINTS_IN_CORNER, part, IN_CORNER, values
    return None


def sensor_rectangle(lens: Intrinsics) -> Float64Array:
    """Return left, top, width and height of the sensor in pixels of the image."""
    return np.array(lens.sensor or (0.0, 0.0, lens.width, lens.height), dtype=np.float64)
