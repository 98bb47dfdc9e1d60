"""Why a calibration, or a camera of it, is rejected."""

from __future__ import annotations

from collections.abc import Sequence

from stcalib_ros.core.model.calibration import Status, UncalibratedCamera


class Insufficient(Exception):
    """The data cannot be calibrated; becomes a `Calibration` with that status.

    Attributes
    ----------
    status : Status
    message : str
    uncalibrated : tuple of UncalibratedCamera
    """

    def __init__(
        self, status: Status, message: str, uncalibrated: Sequence[UncalibratedCamera] = ()
    ) -> None:
        super().__init__(message)
        self.status, self.message = status, message
        self.uncalibrated = tuple(uncalibrated)
