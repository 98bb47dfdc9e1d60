"""Pictures are there and show something."""

from __future__ import annotations

import dataclasses
import io

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import imread

from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.stages import Stages
from stcalib_ros.core.synthetic import Scene
from stcalib_ros.report.draw_errors import camera_errors, errors_figure
from stcalib_ros.report.figures import errors_png, overview_png, sightings_png
from stcalib_ros.report.style import PALETTE


def pixels(png: bytes) -> np.ndarray:
    return imread(io.BytesIO(png), format="png")[..., :3]


def shows(picture: np.ndarray, color: str) -> int:
    """How many pixels have a colour."""
    return int((np.abs(picture - np.array(to_rgb(color))).max(-1) < 0.02).sum())


def test_the_overview_shows_every_camera(report_scene: Scene, report_stages: Stages) -> None:
    picture = pixels(overview_png(report_stages, report_scene.truth))
    assert picture.shape == (800, 1600, 3)
    left, right = picture[:, :950], picture[:, 950:]
    for color in PALETTE[:3]:
        assert shows(left, color) > 300
        assert shows(right, color) > 300
    assert shows(picture, PALETTE[3]) == 0
    assert picture[:, :8].min() > 0.8, "something is cut off at the left"
    assert picture[:, -4:].min() > 0.8, "something is cut off at the right"


def test_the_same_scene_gives_the_same_picture(report_stages: Stages) -> None:
    assert overview_png(report_stages) == overview_png(report_stages)


def test_true_cameras_are_drawn(report_scene: Scene, report_stages: Stages) -> None:
    assert overview_png(report_stages) != overview_png(report_stages, report_scene.truth)


def test_errors_are_those_of_the_calibration(report_stages: Stages) -> None:
    cameras = camera_errors(report_stages)
    assert [c.name for c in cameras] == ["cam0", "cam1", "cam2"]
    everything = np.concatenate([c.inliers for c in cameras])
    calibration = report_stages.calibration
    assert len(everything) == calibration.n_inliers
    rms = np.sqrt((everything**2).mean())
    assert rms == pytest.approx(calibration.reprojection_rms_px)
    assert all(0.5 < c.inlier_fraction <= 1.0 for c in cameras)


@pytest.mark.parametrize("n", [1, 4, 5, 9])
def test_histograms_of_any_number_of_cameras(report_stages: Stages, n: int) -> None:
    (first, *_) = camera_errors(report_stages)
    figure = errors_figure([dataclasses.replace(first, name=f"cam{i}") for i in range(n)])
    titles = [ax.get_title(loc="left") or ax.get_title() for ax in figure.axes]
    assert [t for t in titles if t] == [f"cam{i}" for i in range(n)]


def test_histograms_have_the_cameras_colours(report_stages: Stages) -> None:
    picture = pixels(errors_png(report_stages))
    assert all(shows(picture, color) > 1000 for color in PALETTE[:3])


def test_sightings_show_tracks_of_every_camera(report_scene: Scene) -> None:
    picture = pixels(sightings_png(report_scene.recording))
    assert all(shows(picture, color) > 1000 for color in PALETTE[:3])


def test_sightings_of_cameras_without_tracks_or_images(report_scene: Scene) -> None:
    blind, dead = report_scene.recording.cameras[:2]
    cameras = (
        dataclasses.replace(blind, tracks=()),
        dataclasses.replace(dead, tracks=(), stamps=np.zeros(0)),
    )
    assert pixels(sightings_png(Recording(cameras))).size


def test_nothing_is_left_behind_in_matplotlib(report_stages: Stages) -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    before = dict(pyplot.rcParams)
    overview_png(report_stages)
    assert pyplot.get_fignums() == []
    assert dict(pyplot.rcParams) == before
    assert isinstance(errors_figure(camera_errors(report_stages)), Figure)
