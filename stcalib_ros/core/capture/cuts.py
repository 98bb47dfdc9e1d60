"""Where to cut the videos of cameras so that they begin and end at one time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.capture.reprojection import reference_times
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.interpolation import frame_period
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.recording import Recording

SAME_RATE = 0.01
"""Ratio. Frame rates that differ by less are one, like 29.97 and 30 Hz: what remains is said at the
last image. Chosen; the next usual rates, 24 and 25 Hz, differ by 4 %."""


@dataclass(frozen=True, slots=True)
class VideoCut:
    """The part of one camera's images that all cameras have.

    Attributes
    ----------
    camera : str
    first : int
        Number of its first image, counted from 0.
    n_images : int
        How many there are from there on.
    begin_s : float
        Time of the first image after the first one of the camera, seconds by its own clock.
    rate_hz : float
        Its images per second.
    other_rate : bool
        The reference camera has another rate.
    late_frames, late_at_end_frames : float
        What no cut takes away: by how much its first image, and its last one, are later than those
        of the reference camera, in frames of its own.
    """

    camera: str
    first: int
    n_images: int
    begin_s: float
    rate_hz: float
    other_rate: bool
    late_frames: float
    late_at_end_frames: float


def video_cuts(recording: Recording, calibration: Calibration) -> tuple[VideoCut, ...]:
    """Return where to cut the videos of all calibrated cameras.

    Parameters
    ----------
    recording : Recording
        Whose images are the frames of the videos, the first image the first frame.
    calibration : Calibration
        For time offsets and clock skews.

    Raises
    ------
    InputError
        Fewer than two cameras are in both, or they have no common time.
    """
    times_s = reference_times(recording, calibration)
    if len(times_s) < 2:
        recorded = ", ".join(camera.name for camera in recording.cameras)
        known = ", ".join(camera.name for camera in calibration.cameras)
        raise InputError(
            f"two calibrated cameras are needed: the recording has {recorded}, and the calibration "
            f"{known or 'none'}; their names have to be the same"
        )
    first_s = max(float(times[0]) for times in times_s.values())
    last_s = min(float(times[-1]) for times in times_s.values())
    if first_s >= last_s:
        raise InputError(
            f"there is no time at which all cameras recorded: by their clocks, one begins "
            f"{first_s - last_s:.1f} s after another one has ended"
        )
    reference = calibration.reference if calibration.reference in times_s else next(iter(times_s))
    start, end = _nearest(times_s[reference], first_s), _nearest(times_s[reference], last_s)
    ends_s = float(times_s[reference][start]), float(times_s[reference][end])
    reference_hz = 1.0 / frame_period(times_s[reference])
    stamps = {camera.name: camera.stamps for camera in recording.cameras}
    return tuple(
        _cut(name, stamps[name], times, ends_s, reference_hz) for name, times in times_s.items()
    )


def _cut(
    name: str,
    stamps: Float64Array,
    times_s: Float64Array,
    ends_s: tuple[float, float],
    reference_hz: float,
) -> VideoCut:
    period_s = frame_period(times_s)
    first, last = _nearest(times_s, ends_s[0]), _nearest(times_s, ends_s[1])
    return VideoCut(
        camera=name,
        first=first,
        n_images=last - first + 1,
        begin_s=float(stamps[first] - stamps[0]),
        rate_hz=1.0 / period_s,
        other_rate=abs(1.0 / (period_s * reference_hz) - 1.0) > SAME_RATE,
        late_frames=float(times_s[first] - ends_s[0]) / period_s,
        late_at_end_frames=float(times_s[last] - ends_s[1]) / period_s,
    )


def _nearest(times_s: Float64Array, when_s: float) -> int:
    """Return the number of the image that is nearest to a time."""
    return int(np.abs(times_s - when_s).argmin())
