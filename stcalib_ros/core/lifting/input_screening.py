"""What is wrong with the input of single cameras: put right where it can be, else named.

Before registration a fault of one camera's input looks like what it is; afterwards it looks like a
disagreement between cameras.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from stcalib_ros.core.lifting.keypoint_checks import (
    keypoint_faults,
    keypoint_remarks,
    without_people,
)
from stcalib_ros.core.lifting.pose_axes import with_projecting_poses
from stcalib_ros.core.lifting.pose_units import in_metres
from stcalib_ros.core.lifting.time_base import mended_time_base
from stcalib_ros.core.lifting.track_checks import track_faults
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.model.rejection import Rejection, Remark
from stcalib_ros.core.options import Options


@dataclass(frozen=True, slots=True, eq=False)
class ScreenedInput:
    """A recording that can be calibrated.

    Attributes
    ----------
    recording : Recording
        Put right where that is possible; cameras with a fault see nobody.
    faults : mapping of str to Rejection
        Why the input of a camera cannot be used, by the camera's name.
    remarks : tuple of Remark
        What was put right.
    """

    recording: Recording
    faults: Mapping[str, Rejection]
    remarks: tuple[Remark, ...]


def screen_input(recording: Recording, options: Options) -> ScreenedInput:
    """Find the faults of every camera's input.

    Parameters
    ----------
    recording : Recording
    options : Options
    """
    timed = mended_time_base(recording, options)
    recording = timed.recording
    faults = track_faults(recording) | keypoint_faults(recording, min_score=options.min_score)
    faults |= timed.faults
    remarks = keypoint_remarks(recording, min_score=options.min_score) + timed.remarks
    usable = without_people(recording, faults)
    needed = options.registration.method == "vmf"
    cameras = list(usable.cameras)
    for k, given in enumerate(usable.cameras if not needed else ()):
        cameras[k], axes = with_projecting_poses(given, min_score=options.min_score)
        remarks += axes
    in_units, units = in_metres(cameras, needed=needed)
    return ScreenedInput(replace(usable, cameras=in_units), faults, remarks + units)
