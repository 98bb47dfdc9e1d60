"""Changes of a camera while it records: it is rotated or moved, or its clock jumps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.arrays import Float64Array


@dataclass(frozen=True, slots=True)
class CameraChange:
    """A change of one camera at one moment, for good; a later one adds to it.

    Attributes
    ----------
    camera : int
        Index into the rig.
    at_s : float
        Time by the reference clock, seconds since the epoch.
    turn_rad : (float, float, float)
        Rotation vector of the camera in its optical frame.
    shift_m : (float, float, float)
        Displacement of its centre, in its optical frame before the rotation.
    clock_s : float
        Advance of its timestamps from then on. Images whose stamps would not be later than all
        before are lost.
    """

    camera: int
    at_s: float
    turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    clock_s: float = 0.0


def poses_over_time(
    R_cam_world: Float64Array,
    t_cam_world: Float64Array,
    times: Float64Array,
    changes: Sequence[CameraChange],
) -> tuple[Float64Array, Float64Array]:
    """Return the poses (T, 3, 3) and (T, 3) of one camera at times of the reference clock."""
    R, t = np.tile(R_cam_world, (len(times), 1, 1)), np.tile(t_cam_world, (len(times), 1))
    for change in changes:
        after = times >= change.at_s
        R_new_old = exp_so3(-np.array(change.turn_rad))
        R[after] = R_new_old @ R[after]
        t[after] = (t[after] - np.array(change.shift_m)) @ R_new_old.T
    return R, t


def stamps_over_time(
    stamps: Float64Array, times: Float64Array, changes: Sequence[CameraChange]
) -> Float64Array:
    """Return the timestamps (T,) of images taken at reference times; NaN where one is lost."""
    out = np.array(stamps)
    for change in changes:
        out[times >= change.at_s] += change.clock_s
    later = np.concatenate([[True], out[1:] > np.maximum.accumulate(out)[:-1]])
    return np.where(later, out, np.nan)
