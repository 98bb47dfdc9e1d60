"""What is wrong with the input of single cameras: put right where it can be, else named.

Before registration a fault of one camera's input looks like what it is; afterwards it looks like a
disagreement between cameras.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.lifting.assumed_lenses import with_assumed_lenses
from stcalib_ros.core.lifting.clock_guess import with_aligned_clocks
from stcalib_ros.core.lifting.input_values import (
    with_scores_of_one,
    without_repeated_images,
    without_undetected,
)
from stcalib_ros.core.lifting.intrinsics_checks import intrinsics_faults
from stcalib_ros.core.lifting.keypoint_axes import (
    turned_images,
    with_own_layout,
    with_x_before_y,
)
from stcalib_ros.core.lifting.keypoint_checks import (
    keypoint_faults,
    keypoint_remarks,
    without_people,
)
from stcalib_ros.core.lifting.pose_axes import with_projecting_poses
from stcalib_ros.core.lifting.pose_units import in_metres
from stcalib_ros.core.lifting.read_camera import ReadCamera
from stcalib_ros.core.lifting.time_base import mended_time_base
from stcalib_ros.core.lifting.track_checks import with_tracks
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark
from stcalib_ros.core.model.rejection_text import rejection_sentences
from stcalib_ros.core.options import Options

_UNUSABLE_LENSES = (
    RejectionReason.LENS_UNKNOWN,
    RejectionReason.FOCAL_LENGTH_ABSURD,
    RejectionReason.PRINCIPAL_POINT_OFF_CENTRE,
)
"""Reasons for which CameraInfo is wrong whatever the keypoints are."""


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
    shifts_s : mapping of str to float
        What was added to the stamps of cameras, by name.
    """

    recording: Recording
    faults: Mapping[str, Rejection]
    remarks: tuple[Remark, ...]
    shifts_s: Mapping[str, float]


_STEPS: tuple[Callable[[CameraRecording, float], ReadCamera], ...] = (
    lambda camera, min_score: with_scores_of_one(camera, min_score=min_score),
    lambda camera, min_score: without_undetected(camera, min_score=min_score),
    lambda camera, _: with_tracks(camera),
    lambda camera, min_score: without_repeated_images(camera, min_score=min_score),
    lambda camera, min_score: with_own_layout(camera, min_score=min_score),
    lambda camera, min_score: with_x_before_y(camera, min_score=min_score),
)
"""What is put right of every camera, in this order."""


def screen_input(recording: Recording, options: Options) -> ScreenedInput:
    """Find the faults of every camera's input.

    Parameters
    ----------
    recording : Recording
    options : Options

    Raises
    ------
    InputError
        No camera has a CameraInfo that can be: whoever makes it makes it wrong; or lenses are to
        be shared, or estimated, that cannot; or ``align`` names a camera that is not there.
    """
    aligned = with_aligned_clocks(recording, options)
    assumed = with_assumed_lenses(aligned.recording, options)
    timed = mended_time_base(assumed.recording, options)
    read = [_read(camera, options.min_score) for camera in timed.recording.cameras]
    given = replace(timed.recording, cameras=tuple(one.camera for one in read))
    faults = {one.camera.name: one.fault for one in read if one.fault is not None}
    faults |= intrinsics_faults(given, min_score=options.min_score) | dict(assumed.faults)
    _require_lenses(given, faults)
    faults |= keypoint_faults(given, min_score=options.min_score)
    faults |= timed.faults
    remarks = sum((one.remarks for one in read), assumed.remarks + timed.remarks)
    remarks = aligned.remarks + remarks
    remarks += keypoint_remarks(given, min_score=options.min_score)
    remarks += turned_images(given, min_score=options.min_score)
    usable = without_people(given, faults)
    # The paper's method cannot do without 3D poses.
    needed = options.registration.method == "vmf"
    cameras, on_poses = _with_usable_poses(usable.cameras, options.min_score, needed=needed)
    return ScreenedInput(
        replace(usable, cameras=cameras), faults, remarks + on_poses, aligned.shifts_s
    )


def _require_lenses(recording: Recording, faults: Mapping[str, Rejection]) -> None:
    unusable = [why for why in faults.values() if why.reason in _UNUSABLE_LENSES]
    unknown = [why.cameras[0] for why in unusable if why.reason is RejectionReason.LENS_UNKNOWN]
    if unusable and len(unusable) == len(recording.cameras):
        rest = [why for why in unusable if why.reason is not RejectionReason.LENS_UNKNOWN]
        together = Rejection(RejectionReason.LENS_UNKNOWN, tuple(unknown), detail="unknown")
        raise InputError("; ".join(rejection_sentences([together, *rest] if unknown else rest)))


def readable_input(recording: Recording, *, min_score: float) -> Recording:
    """Return a recording with all put right that can be, and nothing else.

    Parameters
    ----------
    recording : Recording
    min_score : float
        Joints with a lower score are not looked at.
    """
    read = [_read(camera, min_score).camera for camera in recording.cameras]
    cameras, _ = _with_usable_poses(read, min_score)
    return replace(recording, cameras=cameras)


def _read(camera: CameraRecording, min_score: float) -> ReadCamera:
    """Put right the values, tracks, images and axes of a camera, up to the first fault."""
    found = ReadCamera(camera)
    for step in _STEPS:
        if found.fault is None:
            after = step(found.camera, min_score)
            found = replace(after, remarks=found.remarks + after.remarks)
    return found


def _with_usable_poses(
    given: Sequence[CameraRecording], min_score: float, *, needed: bool = False
) -> tuple[tuple[CameraRecording, ...], tuple[Remark, ...]]:
    """Return cameras without 3D poses that do not project, and with the others in metres."""
    cameras = list(given)
    remarks: tuple[Remark, ...] = ()
    for k, camera in enumerate(given if not needed else ()):
        cameras[k], axes = with_projecting_poses(camera, min_score=min_score)
        remarks += axes
    in_units, units = in_metres(cameras, needed=needed)
    return in_units, remarks + units
