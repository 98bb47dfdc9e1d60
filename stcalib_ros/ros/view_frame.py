"""A frame to look from: z up, the floor at 0; knows no ROS."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stcalib_ros.core.geometry.se3 import inverse
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.output.gravity import find_upright
from stcalib_ros.ros.limits import MIN_LEVEL
from stcalib_ros.ros.sightings import SeenPerson

_BLOCK_S = 1.0
"""Seconds in which every walking person puts a foot down: one step takes about half of that."""


def view_before(*, upright: bool) -> Float64Array:
    """Return the pose T_ref_view (4, 4) while nothing is calibrated.

    Parameters
    ----------
    upright : bool
        The reference frame has z up; else it is the optical frame of a camera, taken as level.
    """
    T = np.eye(4)
    if not upright:
        T[:3, :3] = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    return T


def view_by_cameras(calibration: Calibration) -> Float64Array:
    """Return the pose T_ref_view (4, 4) by the cameras, which are rarely upside down.

    x is where the reference camera looks, along the floor, and z = 0 the height of the lowest
    camera. A result with z up is its own view.
    """
    if calibration.frame_id:
        return np.eye(4)
    z = -np.mean([camera.R_ref_cam[:, 1] for camera in calibration.cameras], axis=0)
    z = z / np.linalg.norm(z) if np.linalg.norm(z) > MIN_LEVEL else np.array([0.0, -1.0, 0.0])
    ahead, above = np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0])
    x = ahead - (ahead @ z) * z
    if np.linalg.norm(x) < MIN_LEVEL:
        x = above - (above @ z) * z
    x /= np.linalg.norm(x)
    R_view_ref = np.stack([x, np.cross(z, x), z])
    lowest = min(float(camera.t_ref_cam @ z) for camera in calibration.cameras)
    return _pose(R_view_ref, -lowest)


def view_by_people(calibration: Calibration, people: Sequence[SeenPerson]) -> Float64Array | None:
    """Return the pose T_ref_view (4, 4) by people; None if they do not determine the vertical.

    As a calibration does it that is asked for a `world_frame`.
    """
    long = [person for person in people if len(person.times_s) > 1]
    if calibration.frame_id or not long:
        return None
    step_s = float(long[0].times_s[1] - long[0].times_s[0])
    paths = [person.joints_ref for person in long]
    upright, _ = find_upright(long[0].layout, paths, block=max(1, round(_BLOCK_S / step_s)))
    return None if upright is None else _pose(upright.R_world_ref, upright.height)


def _pose(R_view_ref: Float64Array, height: float) -> Float64Array:
    """Return T_ref_view of a frame in which the reference is at a height."""
    T_view_ref = np.eye(4)
    T_view_ref[:3, :3], T_view_ref[2, 3] = R_view_ref, height
    return inverse(T_view_ref)
