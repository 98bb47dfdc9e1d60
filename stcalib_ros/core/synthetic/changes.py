"""What happens to a camera while it records: somebody turns or moves it, or its clock jumps."""

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
        By the reference clock, seconds since the epoch.
    turn_rad : (float, float, float)
        Rotation vector by which the camera turns, in its optical frame.
    shift_m : (float, float, float)
        By which its centre moves, in its optical frame before the turn.
    clock_s : float
        What its stamps have more from then on. Images whose stamps would not be later than all
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
    """Poses (T, 3, 3) and (T, 3) of one camera at times of the reference clock."""
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
    """Stamps (T,) of images taken at times of the reference clock; NaN where an image is lost."""
    out = np.array(stamps)
    for change in changes:
        out[times >= change.at_s] += change.clock_s
    later = np.concatenate([[True], out[1:] > np.maximum.accumulate(out)[:-1]])
    return np.where(later, out, np.nan)
