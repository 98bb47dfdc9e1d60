"""Where videos are to be cut."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stcalib_ros.core.capture.cuts import video_cuts
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.core.synthetic import SceneOptions, simulate

SCENE = simulate(SceneOptions(n_cameras=2, n_people=1, n_frames=30))


def recording(*stamps: np.ndarray) -> Recording:
    cameras: tuple[CameraRecording, ...] = SCENE.recording.cameras
    pairs = zip(cameras, stamps, strict=True)
    return Recording(tuple(replace(c, stamps=s, tracks=()) for c, s in pairs), 0)


def calibration(offset_s: float, skew: float = 0.0) -> Calibration:
    first, second = SCENE.truth.cameras
    second = replace(second, time_offset_s=offset_s, clock_skew=skew)
    return replace(SCENE.truth, epoch_s=0.0, cameras=(first, second))


def frames(n: int, fps: float = 25.0) -> np.ndarray:
    return np.arange(n) / fps


def test_a_later_start_is_cut_from_the_other_video() -> None:
    first, second = video_cuts(recording(frames(100), frames(100)), calibration(0.41))
    assert (first.camera, first.first, first.n_images) == ("cam0", 10, 90)
    assert (second.camera, second.first, second.n_images) == ("cam1", 0, 90)
    assert first.begin_s == pytest.approx(0.4)
    assert (first.late_frames, first.other_rate) == (0.0, False)
    assert second.late_frames == pytest.approx(0.25)


def test_a_skew_is_said_at_the_end() -> None:
    cuts = video_cuts(recording(frames(5001), frames(5001)), calibration(0.0, skew=5e-5))
    assert cuts[1].late_frames == pytest.approx(0.0, abs=1e-6)
    assert cuts[1].late_at_end_frames == pytest.approx(0.25, abs=0.01)


def test_what_is_cut_is_never_further_than_half_a_frame_off() -> None:
    rng = np.random.default_rng(3)
    for offset_s in rng.uniform(-2.0, 2.0, 20):
        for cut in video_cuts(recording(frames(200), frames(180)), calibration(float(offset_s))):
            assert abs(cut.late_frames) <= 0.5
            assert abs(cut.late_at_end_frames) <= 0.5


def test_another_rate_is_said() -> None:
    first, second = video_cuts(recording(frames(100), frames(200, 50.0)), calibration(0.0))
    assert (first.other_rate, second.other_rate) == (False, True)
    assert second.rate_hz == pytest.approx(50.0)
    assert second.n_images == pytest.approx(2 * first.n_images, abs=2)


def test_videos_without_a_common_time_are_refused() -> None:
    with pytest.raises(InputError, match=r"begins 6\.0 s after another one has ended"):
        video_cuts(recording(frames(100), frames(100)), calibration(10.0))


def test_cameras_that_were_not_calibrated_are_named() -> None:
    alone = replace(calibration(0.0), cameras=SCENE.truth.cameras[:1])
    with pytest.raises(InputError, match="has cam0, cam1, and the calibration cam0;"):
        video_cuts(recording(frames(10), frames(10)), alone)
