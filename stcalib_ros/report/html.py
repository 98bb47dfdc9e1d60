"""The report of a calibration: one HTML file that needs nothing else."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.io.files import write_text
from stcalib_ros.report import tables
from stcalib_ros.report.clocks import camera_clocks
from stcalib_ros.report.content import ReportContent
from stcalib_ros.report.fits import camera_fits
from stcalib_ros.report.grade import Grade, grade
from stcalib_ros.report.markup import findings, heading, page, paragraph, section
from stcalib_ros.report.room import make_room
from stcalib_ros.report.sections import (
    advice_section,
    clocks_section,
    made_with_section,
    pairs_section,
    persons_section,
    reasons_section,
    residuals_section,
    scene_section,
    timeline_section,
)
from stcalib_ros.wording import count

_OTHER_ERROR = 1.1
"""Ratio of errors. A report from a finished result says why its errors are so much larger than
those of the adjustment, which also corrects single stamps and keypoints."""


def write_report(content: ReportContent, path: Path) -> None:
    """Write the report, whole or not at all.

    Raises
    ------
    InputError
        The file cannot be written, or the library of the 3D view is not installed.
    """
    write_text(path, report_html(content))


def report_html(content: ReportContent) -> str:
    """Text of the report: what was found, or why it was refused, and the evidence.

    Raises
    ------
    InputError
        The library of the 3D view is not installed.
    """
    c = content.calibration
    names = [camera.name for camera in c.cameras]
    fits = camera_fits(content.evidence, names)
    clocks = camera_clocks(content.evidence, names, c.reference, content.options)
    verdict = grade(content, fits, clocks)
    parts = [_verdict(content, verdict)]
    if c.status is not Status.OK:
        parts.append(reasons_section(c))
    if c.cameras:
        room = make_room(c, content.people, content.truth)
        parts.append(scene_section(content, room))
        parts.append(section("Cameras", tables.cameras(c, fits), *tables.directions(c)))
        if lenses := tables.lenses(c):
            parts.append(section("Lenses", lenses, paragraph(tables.LENSES_HELP)))
        parts += [timeline_section(content), clocks_section(content, clocks, room)]
    else:
        parts.append(timeline_section(content))
    parts += [persons_section(c), residuals_section(content, fits), pairs_section(c)]
    parts.append(advice_section(c))
    if c.status is Status.OK:
        parts.append(reasons_section(c))
    parts.append(made_with_section(content))
    title = "Calibration" if c.status is Status.OK else "Calibration refused"
    return page(title, filter(None, parts))


def _verdict(content: ReportContent, verdict: Grade) -> str:
    """Say what the outcome is, and what its numbers mean."""
    c = content.calibration
    parts = [heading(verdict.title, good=verdict.good)]
    if c.cameras:
        parts.append(paragraph(_found(c), lead=True))
    parts.append(paragraph(verdict.meaning))
    parts.append(findings((one.good, one.text) for one in verdict.findings))
    begin, end = c.window_s
    started = datetime.fromtimestamp(begin, timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")
    about = f"Recording of {started}, {end - begin:.2f} s long."
    parts.append(paragraph(" ".join([about, *_gathered_again(content)]), faint=True))
    return "\n".join(filter(None, parts))


def _found(c: Calibration) -> str:
    total = len(c.cameras) + len(c.uncalibrated)
    who = "1 person" if len(c.persons) == 1 else f"{len(c.persons)} people"
    text = f"{len(c.cameras)} of {count(total, 'camera')} placed by {who}"
    if c.status is Status.OK:
        return f"{text}, and their clocks set to that of {c.reference}."
    return f"Found, but not to be used: {text}."


def _gathered_again(content: ReportContent) -> list[str]:
    """Say where residuals come from that are not those of the adjustment."""
    if not content.from_result:
        return []
    if content.evidence is None:
        return ["Nobody in it is seen by two of these cameras at a time."]
    now, then = content.evidence.last.rms_px(), content.calibration.reprojection_rms_px
    text = "Residuals are those of this recording by the finished result."
    if now > _OTHER_ERROR * then:
        text += (
            f" The adjustment itself came to {then:.1f} px: it also corrects the stamps of single "
            "images, and errors that keypoints have in common."
        )
    return [text]
