"""Calibrations from before a camera moved or its clock jumped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stcalib_ros.core.geometry.so3 import exp_so3

TURN = tuple(np.radians([1.2, -1.0, 1.3]))
ZERO = (0.0, 0.0, 0.0)


def outdated(truth, name, *, turn=ZERO, shift=ZERO, clock_s=0.0):
    """The calibration of before a camera was turned and shifted, and its clock jumped."""

    def before(camera):
        R = camera.R_ref_cam @ exp_so3(-np.array(turn))
        return replace(
            camera,
            R_ref_cam=R,
            t_ref_cam=camera.t_ref_cam - R @ shift,
            time_offset_s=camera.time_offset_s + clock_s,
        )

    cameras = tuple(before(c) if c.name == name else c for c in truth.cameras)
    return replace(truth, cameras=cameras)


def in_units(calibration, unit):
    cameras = tuple(replace(c, t_ref_cam=c.t_ref_cam / unit) for c in calibration.cameras)
    return replace(calibration, cameras=cameras, metric=False)
