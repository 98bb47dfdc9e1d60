"""What all cameras have up to one time of the reference clock; knows no ROS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.io.assemble import CameraImages
from stcalib_ros.io.messages import NS
from stcalib_ros.io.stamps import ClockCorrection
from stcalib_ros.ros.limits import ARRIVING_S, LATE_S, MIN_CAMERAS


@dataclass(frozen=True, slots=True)
class CommonTime:
    """Up to when cameras have sent images.

    Attributes
    ----------
    end_s : float
        The first of their newest stamps, without cameras far behind: seconds, reference clock.
    lead_s : mapping of str to float
        By how far each is ahead of the others, seconds.
    """

    end_s: float
    lead_s: Mapping[str, float]


def common_time(
    images: Sequence[CameraImages],
    clocks: Mapping[str, ClockCorrection],
    arriving: Mapping[str, float],
) -> CommonTime | None:
    """Return up to when the cameras that are sending have images.

    Parameters
    ----------
    images : sequence of CameraImages
    clocks : mapping of str to ClockCorrection
        Of the cameras that count.
    arriving : mapping of str to float
        Seconds since the last message of each camera.

    Returns
    -------
    CommonTime or None
        None if fewer than `MIN_CAMERAS` are sending.
    """
    newest = {
        c.name: clocks[c.name].apply(c.images[-1].stamp_ns) / NS
        for c in images
        if c.name in clocks and arriving[c.name] <= ARRIVING_S
    }
    if len(newest) < MIN_CAMERAS:
        return None
    lead_s = {name: _lead(name, newest) for name in newest}
    return CommonTime(min(t for name, t in newest.items() if lead_s[name] >= -LATE_S), lead_s)


def _lead(name: str, newest_s: Mapping[str, float]) -> float:
    """Seconds by which the newest stamp of a camera is ahead of those of the others."""
    if len(newest_s) == 2:
        return newest_s[name] - next(t for other, t in newest_s.items() if other != name)
    return newest_s[name] - float(np.median(list(newest_s.values())))


def part_between(
    camera: CameraImages, start_s: float, end_s: float, clock: ClockCorrection
) -> CameraImages:
    """Return the images of a camera between two times of the reference clock, seconds."""
    first, last = (round(clock.camera_time(t) * NS) for t in (start_s, end_s))
    return replace(camera, images=[i for i in camera.images if first <= i.stamp_ns < last])
