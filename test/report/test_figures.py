"""Pictures are there and show something."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import imread

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.report.content import ReportContent
from stcalib_ros.report.draw_errors import errors_figure
from stcalib_ros.report.draw_sightings import sightings_figure
from stcalib_ros.report.figures import overview_png, write_figures
from stcalib_ros.report.fits import KeypointFit, camera_fits
from stcalib_ros.report.style import PALETTE

NAMES = ["cam0", "cam1", "cam2"]


@pytest.fixture(scope="module")
def written(report_content: ReportContent, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("figures") / "new"
    write_figures(report_content, folder)
    return folder


@pytest.fixture(scope="module")
def fits(report_content: ReportContent) -> tuple[KeypointFit, ...]:
    return camera_fits(report_content.evidence, NAMES)


def pixels(png: bytes) -> np.ndarray:
    return imread(io.BytesIO(png), format="png")[..., :3]


def shows(picture: np.ndarray, color: str) -> int:
    """How many pixels have a colour."""
    return int((np.abs(picture - np.array(to_rgb(color))).max(-1) < 0.02).sum())


def test_every_figure_is_written_for_a_talk_and_for_a_paper(written: Path) -> None:
    names = [
        f"{name}.{suffix}"
        for name in ("overview", "residuals", "residuals_by_angle", "tracks")
        for suffix in ("png", "svg")
    ]
    assert sorted(path.name for path in written.iterdir()) == names
    assert (written / "overview.svg").read_text().lstrip().startswith("<?xml")


def test_the_overview_shows_every_camera(written: Path) -> None:
    picture = pixels((written / "overview.png").read_bytes())
    assert picture.shape == (800, 1600, 3)
    left, right = picture[:, :950], picture[:, 950:]
    for color in PALETTE[:3]:
        assert shows(left, color) > 300
        assert shows(right, color) > 300
    assert shows(picture, PALETTE[3]) == 0
    assert picture[:, :8].min() > 0.8, "something is cut off at the left"
    assert picture[:, -4:].min() > 0.8, "something is cut off at the right"


def test_the_same_scene_gives_the_same_picture(
    report_content: ReportContent, written: Path
) -> None:
    assert overview_png(report_content) == (written / "overview.png").read_bytes()


def test_true_cameras_are_drawn(report_content: ReportContent, written: Path) -> None:
    without = dataclasses.replace(report_content, truth=None)
    assert overview_png(without) != (written / "overview.png").read_bytes()


@pytest.mark.parametrize("n", [1, 4, 5, 9])
def test_histograms_of_any_number_of_cameras(fits: tuple[KeypointFit, ...], n: int) -> None:
    figure = errors_figure([dataclasses.replace(fits[0], name=f"cam{i}") for i in range(n)])
    titles = [ax.get_title(loc="left") or ax.get_title() for ax in figure.axes]
    assert [t for t in titles if t] == [f"cam{i}" for i in range(n)]


@pytest.mark.parametrize("name", ["residuals", "residuals_by_angle", "tracks"])
def test_figures_have_the_cameras_colours(written: Path, name: str) -> None:
    picture = pixels((written / f"{name}.png").read_bytes())
    assert all(shows(picture, color) > 1000 for color in PALETTE[:3])


def test_sightings_of_cameras_without_tracks_or_images(report_content: ReportContent) -> None:
    blind, dead = report_content.recording.cameras[:2]
    cameras = (
        dataclasses.replace(blind, tracks=()),
        dataclasses.replace(dead, tracks=(), stamps=np.zeros(0)),
    )
    assert isinstance(sightings_figure(Recording(cameras)), Figure)


def test_nothing_is_left_behind_in_matplotlib(report_content: ReportContent) -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    before = dict(pyplot.rcParams)
    overview_png(report_content)
    assert pyplot.get_fignums() == []
    assert dict(pyplot.rcParams) == before


def test_a_folder_that_cannot_be_made(report_content: ReportContent, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot write figures to"):
        write_figures(report_content, tmp_path / "file" / "figures")
