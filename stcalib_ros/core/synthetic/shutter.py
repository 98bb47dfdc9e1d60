"""Positions of joints at the times at which a rolling shutter reads their rows."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.core.synthetic.people import PersonMotion

_PASSES = 5
"""Fixed-point passes; each multiplies the error by the rows that a joint moves per row time."""


def joints_by_row(
    person: PersonMotion,
    times: Float64Array,
    R_cam_world: Float64Array,
    t_cam_world: Float64Array,
    lens: Intrinsics,
    line_s: float,
) -> Float64Array:
    """Return joints (T, J, 3) in the optical frame, each at the time of its row.

    Parameters
    ----------
    person : PersonMotion
    times : (T,) ndarray
        Times of row 0 by the reference clock, seconds.
    R_cam_world, t_cam_world : (T, 3, 3) and (T, 3) ndarray
    lens : Intrinsics
    line_s : float
        Seconds per row; 0: all rows at once.
    """
    R_T, t = R_cam_world.swapaxes(1, 2), t_cam_world[:, None]
    joints = np.asarray(person(times) @ R_T + t)
    if line_s == 0.0:
        return joints
    for _ in range(_PASSES):
        row = np.clip(np.nan_to_num(project(joints, lens)[..., 1]), 0.0, lens.height)
        when = times[:, None] + line_s * row
        world = np.stack([person(when[:, j])[:, j] for j in range(joints.shape[1])], axis=1)
        joints = np.asarray(world @ R_T + t)
    return joints
