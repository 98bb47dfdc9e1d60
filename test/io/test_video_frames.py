"""Frames of videos by the clocks of cameras."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from film_helpers import made_at, with_stamps, write_film

import stcalib_ros as st
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.io.bag_origin import film_key
from stcalib_ros.io.convert_options import ConvertOptions
from stcalib_ros.io.film_files import film_id
from stcalib_ros.io.video_frames import VideoPlaces, with_frames

MADE_S = 1_790_000_000
EVERY_S = 0.1


def recorded(stamps: np.ndarray, epoch_s: int = MADE_S) -> Recording:
    """A recording of two cameras without people."""
    scene = st.simulate(st.SceneOptions(n_cameras=2, n_people=1, n_frames=4))
    cameras = (replace(camera, stamps=stamps, tracks=()) for camera in scene.recording.cameras)
    return Recording(tuple(cameras), epoch_s * 10**9)


def frames(
    recording: Recording, video: Path, begins_s: dict[str, float], *, is_source: bool = False
) -> tuple[np.ndarray, list[str]]:
    """Stamps of the frames of the first camera, and warnings."""
    warnings: list[str] = []
    origin = {film_key("cam0"): film_id(video)} if is_source else {}
    places = VideoPlaces(origin, begins_s, warnings.append)
    found = with_frames(recording, {"cam0": video}, places)
    assert found.cameras[1] is recording.cameras[1]
    return found.cameras[0].stamps, warnings


def test_as_many_frames_as_images_are_these(tmp_path: Path) -> None:
    stamps = np.cumsum(np.full(20, 0.11))
    found, warnings = frames(recorded(stamps), write_film(tmp_path / "a.mp4", range(20)), {})
    np.testing.assert_array_equal(found, stamps)
    assert warnings == []


def test_frames_have_the_times_of_the_video(tmp_path: Path) -> None:
    times_s = np.cumsum(np.tile([0.1, 0.05], 10)) - 0.1
    video = with_stamps(write_film(tmp_path / "a.mp4", range(20)), times_s)
    found, warnings = frames(recorded(5.0 + times_s[::2]), video, {})
    np.testing.assert_allclose(found, 5.0 + times_s, atol=2e-3)
    assert warnings == []


def test_the_first_image_where_it_is_said_to_be(tmp_path: Path) -> None:
    video = write_film(tmp_path / "a.mp4", range(20))
    found, warnings = frames(recorded(5.0 + EVERY_S * np.arange(15)), video, {"cam0": 0.5})
    np.testing.assert_allclose(found, 4.5 + EVERY_S * np.arange(20), atol=2e-3)
    assert warnings == []


@pytest.mark.parametrize(("n", "warning"), [(12, "0.80 s longer"), (28, "0.80 s shorter")])
def test_videos_of_another_length_are_named(tmp_path: Path, n: int, warning: str) -> None:
    video = write_film(tmp_path / "a.mp4", range(20))
    found, warnings = frames(recorded(EVERY_S * np.arange(n)), video, {})
    np.testing.assert_allclose(found, EVERY_S * np.arange(20), atol=2e-3)
    assert len(warnings) == 1
    assert f"a.mp4 is {warning} than the images of cam0" in warnings[0]
    assert ("--bag-begins cam0=0.80" in warnings[0]) == (n == 12)


@pytest.mark.parametrize("says_when", [False, True])
def test_a_bag_made_from_the_video_tells_by_its_stamps(tmp_path: Path, says_when: bool) -> None:
    video = write_film(tmp_path / "a.mp4", range(20))
    if says_when:
        made_at(video, MADE_S)
    epoch_s = MADE_S if says_when else ConvertOptions().start_s
    recording = recorded(0.5 + EVERY_S * np.arange(15), epoch_s)
    found, warnings = frames(recording, video, {}, is_source=True)
    np.testing.assert_allclose(found, EVERY_S * np.arange(20), atol=2e-3)
    assert warnings == []
