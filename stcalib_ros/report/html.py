"""The report of a calibration: one HTML file that needs nothing else."""

from __future__ import annotations

from pathlib import Path

from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.stages import Stages
from stcalib_ros.io.files import write_text
from stcalib_ros.report import tables
from stcalib_ros.report.figures import errors_png, overview_png, sightings_png
from stcalib_ros.report.markup import image, page, paragraph, section

_OVERVIEW = (
    "Left: cameras, people at four time steps and the paths of their feet; thin black outlines, if "
    "any, are the true cameras after similarity alignment. Right: the height of one joint where "
    "the line of sight of each camera's own keypoint passes nearest to the triangulated joint, "
    "by the stamps of that camera and by the common clock. Every camera has its colour."
)
_ERRORS = (
    "Distance between keypoints and reprojected joints. Colour: inliers, from which the "
    "calibration is made; grey: outliers. The last bar has all that are further away."
)
_SIGHTINGS = (
    "Every line is a track of a camera's own tracker, against the stamps of that camera in seconds "
    "since the start of the recording; clocks are not corrected."
)


def write_report(
    recording: Recording, stages: Stages, path: Path, *, truth: Calibration | None = None
) -> None:
    """Write the report, whole or not at all.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    write_text(path, report_html(recording, stages, truth=truth))


def report_html(recording: Recording, stages: Stages, *, truth: Calibration | None = None) -> str:
    """Text of the report: what was found, or why it was refused, and the evidence.

    Parameters
    ----------
    recording : Recording
    stages : Stages
        Of this recording; with or without camera poses.
    truth : Calibration, optional
        Shown in the picture.
    """
    c = stages.calibration
    parts = [tables.verdict(c)]
    if c.cameras:
        parts.append(image(overview_png(stages, truth), "Cameras and people", _OVERVIEW))
        parts.append(section("Cameras", tables.cameras(stages), *tables.directions(c)))
    if lenses := tables.lenses(c):
        parts.append(section("Lenses", lenses, paragraph(tables.LENSES_HELP)))
    if c.uncalibrated:
        parts.append(section("Not calibrated", tables.uncalibrated(c)))
    if c.persons:
        parts.append(section("Persons", tables.persons(c), paragraph(tables.PERSONS_HELP)))
    if c.pairs:
        parts.append(section("Pairs of cameras", tables.pairs(c), paragraph(tables.PAIRS_HELP)))
    if c.n_inliers:
        parts.append(
            section("Reprojection errors", image(errors_png(stages), "Histograms", _ERRORS))
        )
    seen = image(sightings_png(recording), "Tracks over time", _SIGHTINGS)
    parts.append(section("What the cameras saw", tables.sightings(recording), seen))
    title = "Calibration" if c.status is Status.OK else "Calibration refused"
    return page(title, parts)
