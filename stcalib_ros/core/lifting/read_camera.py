"""What reading one camera's input comes to."""

from __future__ import annotations

from dataclasses import dataclass

from stcalib_ros.core.model.recording import CameraRecording
from stcalib_ros.core.model.rejection import Rejection, Remark


@dataclass(frozen=True, slots=True, eq=False)
class ReadCamera:
    """A camera whose input was put right, as far as that can be had.

    Attributes
    ----------
    camera : CameraRecording
    remarks : tuple of Remark
        What was put right.
    fault : Rejection or None
        Why it cannot be used.
    """

    camera: CameraRecording
    remarks: tuple[Remark, ...] = ()
    fault: Rejection | None = None
