"""When each camera had images and saw people, on the common clock where that is known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from html import escape

import numpy as np

from stcalib_ros.core.geometry.interpolation import frame_period, frame_rate
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.clocks import clock_correction
from stcalib_ros.core.model.recording import CameraRecording
from stcalib_ros.report.content import ReportContent
from stcalib_ros.report.style import camera_colors
from stcalib_ros.wording import count

BRIDGED = 2.6
"""Frame periods. Longer intervals are gaps, in images as in tracks: one lost image is none."""
_WIDTH, _TRACK, _SPACE = 1000.0, 6.0, 3.0
"""Units of the drawing, and of its height: px."""
_MOST_ROWS = 12
"""Tracks of a camera that have a row of their own; further ones share these."""


@dataclass(frozen=True, slots=True, eq=False)
class ImageTimes:
    """Images of one camera over time.

    Attributes
    ----------
    camera : CameraRecording
    times_s : (N,) ndarray
        Of the images, by the common clock, or its own where it is not calibrated; seconds since
        the epoch of the recording.
    on_common_clock : bool
    gaps : tuple of (float, float)
        Begin and end of the times without images.
    """

    camera: CameraRecording
    times_s: Float64Array
    on_common_clock: bool
    gaps: tuple[tuple[float, float], ...]


def image_times(content: ReportContent) -> tuple[ImageTimes, ...]:
    """Return the times of the images of all cameras, in the order of the recording."""
    calibration, recording = content.calibration, content.recording
    known = {camera.name: camera for camera in calibration.cameras}
    since_epoch_s = recording.epoch_ns * 1e-9 - calibration.epoch_s
    found = []
    for camera in recording.cameras:
        times = camera.stamps
        if (own := known.get(camera.name)) is not None:
            later = clock_correction(own.time_offset_s, own.clock_skew, times + since_epoch_s)
            times = times + later
        gaps = tuple(zip(*_ends_of_gaps(times, frame_period(times)), strict=True))
        found.append(ImageTimes(camera, times, own is not None, gaps))
    return tuple(found)


def _ends_of_gaps(times: Float64Array, period_s: float) -> tuple[list[float], list[float]]:
    long = np.flatnonzero(np.diff(times) > BRIDGED * period_s)
    return times[long].tolist(), times[long + 1].tolist()


def timeline(content: ReportContent) -> str:
    """Return a row for each camera as markup: its images, their gaps, and its tracks."""
    rows = image_times(content)
    some = [row.times_s for row in rows if len(row.times_s)]
    if not some:
        return ""
    begin = min(float(times[0]) for times in some)
    span = max(max(float(times[-1]) for times in some) - begin, 1e-6)
    colors = camera_colors(camera.name for camera in content.calibration.cameras)
    return "\n".join(_row(row, begin, span, colors.get(row.camera.name, "#888")) for row in rows)


def _row(row: ImageTimes, begin: float, span: float, color: str) -> str:
    tracks = row.camera.tracks
    height = _SPACE + (_TRACK + _SPACE) * max(min(len(tracks), _MOST_ROWS), 1)
    shapes = []
    if len(row.times_s):
        shapes.append(_bar("seen", row.times_s[0], row.times_s[-1], begin, span, 0.0, height))
    shapes += [_bar("gap", a, b, begin, span, 0.0, height) for a, b in row.gaps]
    for k, track in enumerate(tracks):
        y = _SPACE + (_TRACK + _SPACE) * (k % _MOST_ROWS)
        for a, b in _stretches(row, track.frames):
            shapes.append(_bar("track", a, b, begin, span, y, _TRACK, color=color))
    own = "" if row.on_common_clock else " (by its own clock)"
    return (
        f'<div class="strip"><p><b style="color:{color}">{escape(row.camera.name)}</b> '
        f"{escape(_said(row) + own)}</p>"
        f'<svg viewBox="0 0 {_WIDTH:.0f} {height:.0f}" preserveAspectRatio="none" '
        f'style="height:{height:.0f}px" role="img" aria-label="time line">{"".join(shapes)}</svg>'
        "</div>"
    )


def _said(row: ImageTimes) -> str:
    """Rate and gaps in words."""
    n = len(row.times_s)
    if n < 2:
        return count(n, "image")
    text = f"{frame_rate(row.times_s):.1f} images a second, {count(n, 'image')}"
    if not row.gaps:
        return f"{text}, no gaps"
    longest = max(b - a for a, b in row.gaps)
    return f"{text}, {count(len(row.gaps), 'gap')} of up to {longest:.2f} s"


def _stretches(row: ImageTimes, frames: IntArray) -> Iterator[tuple[float, float]]:
    """Yield the intervals in which a track is seen without gaps."""
    times = row.times_s[frames]
    if len(times):
        cuts = np.flatnonzero(np.diff(times) > BRIDGED * frame_period(row.times_s)) + 1
        for part in np.split(times, cuts):
            yield float(part[0]), float(part[-1])


def _bar(
    kind: str,
    first: float,
    last: float,
    begin: float,
    span: float,
    y: float,
    height: float,
    *,
    color: str = "",
) -> str:
    x, width = _WIDTH * (first - begin) / span, _WIDTH * (last - first) / span
    style = f' style="fill:{color}"' if color else ""
    return (
        f'<rect class="{kind}" x="{x:.1f}" y="{y:.0f}" width="{max(width, 1.0):.1f}" '
        f'height="{height:.0f}"{style}/>'
    )
