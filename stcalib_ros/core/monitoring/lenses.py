"""The lenses by which a calibration in force sees what arrives."""

from __future__ import annotations

from dataclasses import replace

from stcalib_ros.core.model.calibration import Calibration, CameraCalibration
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.recording import CameraRecording, Intrinsics, Recording


def with_lenses_in_force(recording: Recording, calibration: Calibration) -> Recording:
    """Return a recording with the lenses that a calibration has estimated.

    The poses hold with these lenses, whatever a driver publishes meanwhile. A lens that was given
    is as the recording has it. Cameras without a lens are left out, and so are those whose images
    have another size than the estimated lens is for.

    Parameters
    ----------
    recording : Recording
    calibration : Calibration
    """
    known = {camera.name: camera for camera in calibration.cameras}
    lenses = [_lens(camera, known.get(camera.name)) for camera in recording.cameras]
    cameras = [
        replace(camera, intrinsics=lens)
        for camera, lens in zip(recording.cameras, lenses, strict=True)
        if lens is not None
    ]
    return replace(recording, cameras=tuple(cameras))


def _lens(camera: CameraRecording, known: CameraCalibration | None) -> Intrinsics | None:
    own = camera.intrinsics
    if known is None or (own.known and known.lens_knowledge is LensKnowledge.GIVEN):
        return own if own.known else None
    lens = known.intrinsics
    same_size = (lens.width, lens.height) == (own.width, own.height)
    return lens if same_size else None
