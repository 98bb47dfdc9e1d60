"""The parts of a report below its verdict."""

from __future__ import annotations

import math
import platform
from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import scipy

from stcalib_ros import __version__
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.gathered_text import as_sentence
from stcalib_ros.core.model.rejection import RemarkCode
from stcalib_ros.core.model.rejection_text import labelled, remark_sentence
from stcalib_ros.core.options import Options
from stcalib_ros.report import tables
from stcalib_ros.report.angles import errors_by_angle
from stcalib_ros.report.charts import Axis, Line, Mark, axis_of, chart
from stcalib_ros.report.clocks import CameraClock
from stcalib_ros.report.content import ReportContent
from stcalib_ros.report.curves import Movement, liveliest_movement
from stcalib_ros.report.fits import KeypointFit
from stcalib_ros.report.image_plane import angle_axis, angle_chart, error_histogram, plane
from stcalib_ros.report.markup import (
    DATA,
    coded,
    folded,
    paragraph,
    section,
    side_by_side,
    subtitle,
    table,
)
from stcalib_ros.report.room import Room
from stcalib_ros.report.scene import scene_data, scene_json
from stcalib_ros.report.style import camera_colors
from stcalib_ros.report.three_js import three_js
from stcalib_ros.report.timeline import timeline
from stcalib_ros.wording import length_unit

_OVERFLOW = 99.0
"""Percent of the errors of keypoints that fit; histograms reach to twice this error."""
_DARKEST = 2.0
"""Ratio of a cell's median error to that of all cameras, from which on cells are darkest."""
_LEAST_HIGH = 1.5
"""Ratio of errors to which the curves of time offsets reach at least."""
_LEAST_MS = 4.0
"""Milliseconds. Least height of a chart of the change of an offset: less is noise."""
_ANGLES_HELP = (
    "Error by angle: medians as lines, the middle half of the keypoints as bands. Outward part: "
    "how much further from the optical axis joints are projected than their keypoints are. With a "
    "right lens it stays near zero. If it clearly leaves zero towards the edge of the image, the "
    "distortion is wrong: calibrate again with --intrinsics refine. A wrong focal length hardly "
    "shows here, because poses compensate for it."
)
_ADVICE = {
    RemarkCode.LEAST_CONSTRAINED_CAMERA,
    RemarkCode.SHARE_MORE_VIEW,
    RemarkCode.MOVE_FASTER,
    RemarkCode.LEAVE_THE_LINE,
    RemarkCode.RECORD_LONGER,
    RemarkCode.CLOCK_SKEW_NOT_OBSERVABLE,
}
"""Remarks that say what is weak and what to do; the others are about the input."""


def scene_section(content: ReportContent, room: Room) -> str:
    """Return the room in 3D, with its controls."""
    data = scene_data(content, room)
    step = "1 m" if content.calibration.metric else "half the distance of the first two cameras"
    text = f"Drag to turn, pinch or scroll to zoom. A square of the floor is {step}."
    text += " Ellipsoids: uncertainty of positions"
    if content.calibration.frame_id:
        text += ", with that of the vertical"
    if data["enlarged"] > 1:
        text += f", {data['enlarged']} times enlarged"
    text += "."
    if data["true_cameras"]:
        text += " Thin outlines: the true cameras, after alignment."
    length = f"{data['length_s']:.6g}"
    controls = (
        '<div class="bar"><button id="play" type="button">Play</button>'
        f'<input id="time" type="range" min="0" max="{length}" step="any" value="0" '
        'aria-label="time"><output id="clock">0.00 s</output>'
        '<select id="speed" aria-label="speed"><option value="0.25">1/4 speed</option>'
        '<option value="0.5">1/2 speed</option><option value="1" selected>real time</option>'
        '<option value="4">4 x speed</option></select>'
        '<button id="reset" type="button">Reset view</button>'
        '<label><input id="ellipsoids" type="checkbox" checked> uncertainty</label></div>'
    )
    script = (DATA / "scene.js").read_text(encoding="utf-8")
    return section(
        "Cameras and people in 3D",
        paragraph(text, faint=True),
        '<div id="scene"><p id="no-webgl" hidden>This browser cannot draw in 3D (WebGL is off). '
        "All numbers are below.</p></div>",
        controls,
        f"<script>{three_js()}</script>",
        f"<script>const SCENE={scene_json(data)};</script>",
        f"<script>{script}</script>",
    )


def timeline_section(content: ReportContent) -> str:
    """Return what every camera recorded, and when."""
    rows = timeline(content)
    if not rows:
        return ""
    text = (
        "Grey: from the first image to the last. Red: times without images. Coloured lines: "
        "people, as the camera's own tracker numbers them."
    )
    seen = folded("What was read of each camera", tables.sightings(content.recording))
    return section("Images and people over time", paragraph(text, faint=True), rows, seen)


def clocks_section(content: ReportContent, clocks: Sequence[CameraClock], room: Room) -> str:
    """Return which time offsets fit, what is left of them over time, and one movement."""
    c = content.calibration
    if not clocks:
        return ""
    colors = camera_colors(camera.name for camera in c.cameras)
    found = {camera.name: 1e3 * camera.time_offset_s for camera in c.cameras}
    text = (
        f"Left: how much worse other time offsets fit than the one that was chosen; a clear valley "
        f"is a distinct offset. Right: by how much the offset to {c.reference} differs from that "
        "in parts of the recording; dots near zero mean that the clocks run alike."
    )
    parts = [paragraph(text, faint=True)]
    if (movement := liveliest_movement(content, room)) is not None:
        parts.append(_movement(movement, colors, length_unit(c.metric)))
    for clock in clocks:
        both = (_curve(clock, colors[clock.name], found[clock.name]), _rest(clock, colors))
        parts.append(side_by_side(*both))
    return section("Clocks", *parts)


def _curve(clock: CameraClock, color: str, found_ms: float) -> str:
    x, y = 1e3 * clock.difference_s, clock.error
    known = np.isfinite(y)
    x_axis = axis_of([x[known]], "difference from the chosen offset, ms")
    y_axis = Axis(
        0.0, max(float(y[known].max(initial=1.0)), _LEAST_HIGH) * 1.08, "error / least error"
    )
    marks = [Mark(0.0, "chosen", color)]
    if clock.runner_up >= 0:
        marks.append(Mark(float(x[clock.runner_up]), f"next: {clock.ratio:.1f} x", "#888"))
    return chart(
        f"{clock.name}: {found_ms:+.1f} ms", [Line(x, y, color)], x_axis, y_axis, marks=marks
    )


def _rest(clock: CameraClock, colors: dict[str, str]) -> str:
    y = 1e3 * clock.change_s
    if not len(y):
        return paragraph(f"{clock.name}: too few people to follow its clock over time.", faint=True)
    begin = float(clock.time_s.min())
    x = clock.time_s - begin
    x_axis = axis_of([x], "time, s", least=1.0)
    y_axis = axis_of([y, np.zeros(1)], "change, ms", least=_LEAST_MS)
    zero = Line(np.array([x_axis.low, x_axis.high]), np.zeros(2), "#888")
    title = f"{clock.name}: change of the offset over time"
    return chart(title, [zero, Line(x, y, colors[clock.name], dots=True)], x_axis, y_axis)


def _movement(movement: Movement, colors: dict[str, str], unit: str) -> str:
    """Return one movement by every camera's own clock, and by the common one."""
    begin = min(float(np.nanmin(curve.stamps_s)) for curve in movement.curves)
    heights = [curve.height for curve in movement.curves]
    times = [[curve.stamps_s - begin for curve in movement.curves]]
    times.append([curve.times_s - begin for curve in movement.curves])
    x_axis = axis_of(
        [t[np.isfinite(h)] for row in times for t, h in zip(row, heights, strict=True)], "time, s"
    )
    y_axis = axis_of(heights, f"height, {unit}")
    names = [(curve.camera, colors[curve.camera]) for curve in movement.curves]
    charts = []
    for title, row in zip(("by its own clock", "by the common clock"), times, strict=True):
        lines = [
            Line(time, curve.height, colors[curve.camera])
            for time, curve in zip(row, movement.curves, strict=True)
        ]
        joint = movement.joint.replace("_", " ")
        whole = f"Height of the {joint} of person {movement.person_id}, each camera {title}"
        charts.append(chart(whole, lines, x_axis, y_axis, names=names))
    return side_by_side(*charts)


def persons_section(c: Calibration) -> str:
    """Return who is who."""
    if not c.persons:
        return ""
    return section("Who is who", tables.persons(c), paragraph(tables.PERSONS_HELP, faint=True))


def residuals_section(content: ReportContent, fits: Sequence[KeypointFit]) -> str:
    """Return the residuals of each camera, by size and over its image."""
    good = [fit.errors[fit.fits] for fit in fits if fit.fits.any()]
    if not good:
        return ""
    together = np.concatenate(good)
    limit_px = 2.0 * float(np.percentile(together, _OVERFLOW))
    darkest_px = _DARKEST * float(np.median(together))
    colors = camera_colors(camera.name for camera in content.calibration.cameras)
    lenses = {camera.name: camera.intrinsics for camera in content.calibration.cameras}
    text = (
        "How far joints in 3D, projected into each image, are from its keypoints. Coloured: those "
        "that fit, from which the calibration is made; grey: those that were left out. All shares "
        "are of the keypoints of people whom another camera sees at the same time. An even image "
        "with short arrows is what a right lens looks like."
    )
    by_angle = [errors_by_angle(fit, lenses[fit.name]) for fit in fits]
    axis = angle_axis(by_angle)
    rows = [
        side_by_side(
            error_histogram(fit, colors[fit.name], limit_px),
            plane(fit, lenses[fit.name], darkest_px),
            angle_chart(one, colors[fit.name], axis),
        )
        for fit, one in zip(fits, by_angle, strict=True)
    ]
    return section(
        "Residuals", paragraph(text, faint=True), paragraph(_ANGLES_HELP, faint=True), *rows
    )


def pairs_section(c: Calibration) -> str:
    """Return how well every two cameras agree, folded."""
    if not c.pairs:
        return ""
    help_text = paragraph(tables.PAIRS_HELP, faint=True)
    return folded("Pairs of cameras", tables.pairs(c), help_text)


def advice_section(c: Calibration) -> str:
    """Return what is weak, and what would help."""
    advice = [one for one in c.remarks if one.code in _ADVICE]
    if not advice:
        return ""
    return section(
        "What is weak, and what to do next",
        coded((one.code.value, as_sentence(remark_sentence(one), one.cameras)) for one in advice),
    )


def reasons_section(c: Calibration) -> str:
    """Return the reasons of a refusal, of cameras that were left out, and remarks on the input."""
    parts = []
    if c.rejections:
        title = "Why it was refused" if c.status is not Status.OK else "What was left out"
        said = [(one.reason.value, as_sentence(labelled(one), one.cameras)) for one in c.rejections]
        parts += [subtitle(title), coded(said)]
    if c.uncalibrated:
        left = [
            (one.rejection.reason.value, f"{one.name}: {one.reason}.") for one in c.uncalibrated
        ]
        parts += [subtitle("Cameras without a pose"), coded(left)]
    if about_input := [one for one in c.remarks if one.code not in _ADVICE]:
        said = [
            (one.code.value, as_sentence(remark_sentence(one), one.cameras)) for one in about_input
        ]
        parts += [subtitle("About the input"), coded(said)]
    return section("Reasons and remarks", *parts) if parts else ""


def made_with_section(content: ReportContent) -> str:
    """Return options that differ from their defaults, and versions."""
    changed = list(_changed(content.options, Options()))
    rows = [("option", "value"), *changed]
    options = table(rows) if changed else paragraph("All options have their defaults.")
    if content.from_result and not changed:
        options = paragraph("A result file does not say with which options it was made.")
    versions = (
        f"stcalib_ros {__version__}, Python {platform.python_version()}, NumPy {np.__version__}, "
        f"SciPy {scipy.__version__}. The 3D view is drawn by three.js (MIT licence)."
    )
    return section("Options and versions", options, paragraph(versions, faint=True))


def _changed(given: Any, usual: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield the options that are not as usual, with dotted names."""
    for field in fields(given):
        mine, default = getattr(given, field.name), getattr(usual, field.name)
        name = f"{prefix}{field.name}"
        if is_dataclass(default) and not isinstance(default, type) and is_dataclass(mine):
            yield from _changed(mine, default, f"{name}.")
        elif mine != default and not _both_nan(mine, default):
            yield name, str(mine)


def _both_nan(one: Any, other: Any) -> bool:
    return all(isinstance(value, float) and math.isnan(value) for value in (one, other))
