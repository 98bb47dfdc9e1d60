"""The pictures of a report as PNG."""

from __future__ import annotations

import io

import matplotlib
from matplotlib.figure import Figure

from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.stages import Stages
from stcalib_ros.report.curves import liveliest_movement
from stcalib_ros.report.draw_errors import camera_errors, errors_figure
from stcalib_ros.report.draw_sightings import sightings_figure
from stcalib_ros.report.overview import overview_figure
from stcalib_ros.report.room import make_room
from stcalib_ros.report.style import DPI, SETTINGS


def overview_png(stages: Stages, truth: Calibration | None = None) -> bytes:
    """Cameras and people in 3D, and one movement before and after the alignment in time.

    Parameters
    ----------
    stages : Stages
        With camera poses.
    truth : Calibration, optional
        Drawn as thin outlines after similarity alignment.

    Returns
    -------
    bytes
        PNG, 1600 x 800 px.
    """
    room = make_room(stages.calibration, stages.trajectories(), truth)
    movement = liveliest_movement(stages, room)
    with matplotlib.rc_context(SETTINGS):
        return _png(overview_figure(room, movement, title=_title(stages.calibration)))


def _title(c: Calibration) -> str:
    people = "1 person" if len(c.persons) == 1 else f"{len(c.persons)} people"
    title = f"{len(c.cameras)} cameras, placed by {people}"
    return title if c.status is Status.OK else f"Not to be used: {title}"


def errors_png(stages: Stages) -> bytes:
    """Histograms of the reprojection errors of every camera, PNG."""
    with matplotlib.rc_context(SETTINGS):
        return _png(errors_figure(camera_errors(stages)))


def sightings_png(recording: Recording) -> bytes:
    """When each camera saw whom, PNG."""
    with matplotlib.rc_context(SETTINGS):
        return _png(sightings_figure(recording))


def _png(figure: Figure) -> bytes:
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=DPI, metadata={"Software": None})
    return out.getvalue()
