"""Cameras that are left out, for tests that only want a text."""

from __future__ import annotations

from stcalib_ros.core.model.calibration import UncalibratedCamera
from stcalib_ros.core.model.rejection import Rejection, RejectionReason


def left_out(name: str, text: str) -> UncalibratedCamera:
    return UncalibratedCamera(name, Rejection(RejectionReason.UNSPECIFIED, detail=text))
