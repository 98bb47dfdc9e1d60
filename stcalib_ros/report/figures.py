"""The pictures of a calibration for talks and papers, as PNG and SVG."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.io.files import atomic_path
from stcalib_ros.report.angles import errors_by_angle
from stcalib_ros.report.content import ReportContent
from stcalib_ros.report.curves import liveliest_movement
from stcalib_ros.report.draw_angles import angles_figure
from stcalib_ros.report.draw_errors import errors_figure
from stcalib_ros.report.draw_sightings import sightings_figure
from stcalib_ros.report.fits import camera_fits
from stcalib_ros.report.overview import overview_figure
from stcalib_ros.report.room import make_room
from stcalib_ros.report.style import DPI, SETTINGS

_FORMATS = ("png", "svg")


def overview_png(content: ReportContent) -> bytes:
    """Cameras and people in 3D, and one movement before and after the alignment in time.

    Parameters
    ----------
    content : ReportContent
        With camera poses. A truth is drawn as thin outlines after similarity alignment.

    Returns
    -------
    bytes
        PNG, 1600 x 800 px.
    """
    with matplotlib.rc_context(SETTINGS):
        return _encoded(_overview(content), "png")


def write_figures(content: ReportContent, folder: Path) -> tuple[Path, ...]:
    """Write every picture of a calibration as PNG and SVG; return the files.

    Parameters
    ----------
    content : ReportContent
    folder : Path
        Made if it is not there; files of the same names are replaced.

    Raises
    ------
    InputError
        The folder cannot be made or written to.
    """
    written = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with matplotlib.rc_context(SETTINGS):
            for name, draw in _drawn(content).items():
                figure = draw(content)
                for suffix in _FORMATS:
                    path = folder / f"{name}.{suffix}"
                    with atomic_path(path) as temporary:
                        temporary.write_bytes(_encoded(figure, suffix))
                    written.append(path)
    except OSError as error:
        raise InputError(f"cannot write figures to {folder}: {error.strerror}") from error
    return tuple(written)


def _drawn(content: ReportContent) -> Mapping[str, Callable[[ReportContent], Figure]]:
    """Pictures that there is something to show in, by the names of their files."""
    figures: dict[str, Callable[[ReportContent], Figure]] = {"tracks": _tracks}
    if content.calibration.cameras:
        figures["overview"] = _overview
    if content.evidence is not None:
        figures["residuals"] = _residuals
        figures["residuals_by_angle"] = _residuals_by_angle
    return figures


def _overview(content: ReportContent) -> Figure:
    room = make_room(content.calibration, content.people, content.truth)
    movement = liveliest_movement(content, room)
    return overview_figure(room, movement, title=_title(content.calibration))


def _title(c: Calibration) -> str:
    people = "1 person" if len(c.persons) == 1 else f"{len(c.persons)} people"
    title = f"{len(c.cameras)} cameras, placed by {people}"
    return title if c.status is Status.OK else f"Not to be used: {title}"


def _residuals(content: ReportContent) -> Figure:
    names = [camera.name for camera in content.calibration.cameras]
    return errors_figure(camera_fits(content.evidence, names))


def _residuals_by_angle(content: ReportContent) -> Figure:
    lenses = {camera.name: camera.intrinsics for camera in content.calibration.cameras}
    fits = camera_fits(content.evidence, list(lenses))
    return angles_figure([errors_by_angle(fit, lenses[fit.name]) for fit in fits])


def _tracks(content: ReportContent) -> Figure:
    return sightings_figure(content.recording)


def _encoded(figure: Figure, suffix: str) -> bytes:
    out = io.BytesIO()
    date = {"Software": None} if suffix == "png" else {"Date": None}
    figure.savefig(out, format=suffix, dpi=DPI, metadata=date)
    return out.getvalue()
