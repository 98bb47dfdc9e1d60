"""Rolling shutters: the rows of an image are taken one after the other.

A keypoint in row v of an image is observed at ``stamp + line_time * v``; the stamp is the time of
row 0, and so a clock offset is what to add to that. Inside, the times of images are those of the
row in the middle of what the camera sees, so that what takes no notice of rows is off by little.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import CameraRecording, Recording

MAX_READOUT_STDDEV_S = 8e-3
"""Seconds. A line time is observable in the recording if the standard deviation of the time for all
rows is below. Chosen on the rolling shutter scenes of benchmarks.accuracy.level; not verified on
real recordings."""


@dataclass(frozen=True, slots=True)
class Shutter:
    """How a camera reads its images.

    Attributes
    ----------
    line_time_s : float
        Seconds per row; 0: all rows at once.
    middle_row : float
        The row, px, that the times of its images stand for.
    height : int
        Rows of an image.
    """

    line_time_s: float = 0.0
    middle_row: float = 0.0
    height: int = 0

    def times(self, stamps: Float64Array) -> Float64Array:
        """Times (N,) of the middle row, from stamps (N,)."""
        late_s = self.line_time_s * self.middle_row
        return stamps + late_s if late_s else stamps


GLOBAL = Shutter()
"""All rows at once."""


def shutter_of(camera: CameraRecording, *, from_first_row: bool) -> Shutter:
    """Shutter of a camera, its middle the median row of all keypoints, or row 0."""
    rows = [track.keypoints[..., 1].ravel() for track in camera.tracks]
    known = np.concatenate(rows) if rows else np.zeros(0)
    known = known[np.isfinite(known)]
    middle = float(np.median(known)) if len(known) and not from_first_row else 0.0
    return Shutter(camera.line_time_s, middle, camera.intrinsics.height)


def with_known_line_times(recording: Recording, line_times_s: Mapping[str, float]) -> Recording:
    """The recording with line times by name of camera; the others keep theirs."""
    return replace(
        recording,
        cameras=tuple(
            replace(c, line_time_s=line_times_s.get(c.name, c.line_time_s))
            for c in recording.cameras
        ),
    )
