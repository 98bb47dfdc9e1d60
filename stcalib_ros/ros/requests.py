"""What a run is asked to be made of, and why it cannot start; knows no ROS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from stcalib_ros.core.errors import one_line
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.io.assemble import CameraImages
from stcalib_ros.ros.camera_buffer import Counts
from stcalib_ros.ros.limits import MAX_LINE, MIN_CAMERAS
from stcalib_ros.ros.worker import failure


@dataclass(frozen=True, slots=True, eq=False)
class Wanted:
    """What a run would be made of.

    Attributes
    ----------
    names : tuple of str
        Cameras that were asked for; none: all.
    start_s : float
        First stamp to use, seconds, reference clock.
    images : sequence of CameraImages
        What there is of them.
    counts : mapping of str to Counts
        State of every camera.
    """

    names: tuple[str, ...]
    start_s: float
    images: Sequence[CameraImages]
    counts: Mapping[str, Counts]

    def refusal(self, known: Sequence[str]) -> Calibration | None:
        """Return a failure that says why a run of it cannot start; None if it can.

        Parameters
        ----------
        known : sequence of str
            Cameras that there are.
        """
        if unknown := [name for name in self.names if name not in known]:
            wrong = one_line(", ".join(unknown), MAX_LINE)
            return failure(
                Status.INSUFFICIENT_DATA,
                f"not started: no camera {wrong}; there are {', '.join(known)}",
            )
        ready = [c.name for c in self.images if self.counts[c.name].no_lens is None]
        if len(ready) < MIN_CAMERAS:
            there = ", ".join(ready) or "none"
            return failure(
                Status.INSUFFICIENT_DATA,
                "not started: two cameras with poses and CameraInfo are needed (ready: "
                f"{there}); /diagnostics says what the others wait for",
            )
        return None
