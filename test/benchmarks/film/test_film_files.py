"""The film that is in the repository."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.film.cameras import CAMERAS, truth
from benchmarks.film.references import TrueReference
from stcalib_ros.io.lens_files import lenses_of
from stcalib_ros.io.results import read_result

_FILM = Path(__file__).parents[3] / "examples" / "film"
_SECONDS = 24.0
"""Seconds. Length of the film."""


def test_truth_is_that_of_the_cameras_and_their_lenses_can_be_read() -> None:
    found, right = read_result(_FILM / "truth.yaml"), truth(_SECONDS)
    lenses = lenses_of(_FILM / "truth.yaml", [camera.name for camera in CAMERAS])
    for a, b, camera in zip(found.cameras, right.cameras, CAMERAS, strict=True):
        assert np.allclose(a.R_ref_cam, b.R_ref_cam, atol=1e-9)
        assert np.allclose(a.t_ref_cam, b.t_ref_cam, atol=1e-9)
        assert (a.time_offset_s, a.line_time_s) == (camera.offset_s, camera.line_time_s)
        assert np.allclose(lenses[camera.name].K, camera.lens.K)
        assert np.allclose(lenses[camera.name].D[:5], camera.lens.D)


def test_films_are_small_and_there_is_one_of_each_camera() -> None:
    films = sorted(_FILM.glob("*.mp4"))
    assert [film.stem for film in films] == [camera.name for camera in CAMERAS]
    assert sum(film.stat().st_size for film in films) < 8e6


@pytest.mark.parametrize("camera", [CAMERAS[2], CAMERAS[4]], ids=lambda camera: camera.name)
def test_times_in_the_container_are_the_stamps_of_the_camera(camera) -> None:
    film, stamps = cv2.VideoCapture(str(_FILM / f"{camera.name}.mp4")), []
    while film.grab():
        stamps.append(film.get(cv2.CAP_PROP_POS_MSEC) / 1000)
    assert np.allclose(stamps, camera.stamps(_SECONDS), atol=1e-4)


def test_three_people_are_in_view_most_of_the_time_and_hidden_now_and_then() -> None:
    reference = TrueReference(_FILM)
    for camera in CAMERAS:
        seen = [reference.seen(camera.name, stamp, 0) for stamp in np.arange(0, _SECONDS, 0.5)]
        clear = np.array([one.clear for one in seen])
        assert clear.shape[1] == 3
        assert 0.7 < clear.mean() < 0.99
