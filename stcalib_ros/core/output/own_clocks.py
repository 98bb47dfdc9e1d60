"""A calibration for the stamps of the recording, where these were aligned first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from stcalib_ros.core.model.calibration import Calibration


def by_own_clocks(calibration: Calibration, shifts_s: Mapping[str, float]) -> Calibration:
    """Return a calibration whose offsets contain what was added to the stamps before.

    Standard deviations are those at the time of the recording: no skew is extrapolated over what
    was added.

    Parameters
    ----------
    calibration : Calibration
        Of the aligned stamps.
    shifts_s : mapping of str to float
        What was added to the stamps of cameras, by name.
    """
    if not any(shifts_s.values()):
        return calibration
    reference_s = shifts_s.get(calibration.reference, 0.0)
    cameras = []
    for camera in calibration.cameras:
        shift_s = shifts_s.get(camera.name, 0.0) - reference_s
        offset_s = camera.time_offset_s + shift_s + camera.clock_skew * shift_s
        cameras.append(replace(camera, time_offset_s=offset_s))
    begin, end = calibration.window_s
    return replace(
        calibration,
        cameras=tuple(cameras),
        epoch_s=calibration.epoch_s - reference_s,
        window_s=(begin - reference_s, end - reference_s),
    )
