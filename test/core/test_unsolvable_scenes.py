"""Scenes that once led to a wrong calibration that was called OK."""

from __future__ import annotations

import numpy as np
import pytest
from core_helpers import HALF_SECOND, error

from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.synthetic import SceneOptions, scene, simulate
from stcalib_ros.io.mocap import shipped_clips


def assert_right_or_not_ok(options):
    hard = simulate(options)
    calibration = calibrate(hard.recording, HALF_SECOND)
    if calibration.status is Status.OK:
        e = error(calibration, hard.truth)
        assert e.E_R < 0.1, e
        assert e.E_t < 0.1, e
        assert e.E_delta_s < 0.03, e


@pytest.mark.parametrize("seed", range(6, 10))
def test_short_clips_with_bad_poses(seed):
    assert_right_or_not_ok(
        SceneOptions(n_frames=40, n_people=2, lifter_mm=(110.0, 110.0), seed=seed)
    )


def test_one_person_two_cameras():
    assert_right_or_not_ok(SceneOptions(n_cameras=2, n_people=1, n_frames=100, seed=2))


def test_three_identical_people_in_a_row_at_equal_distances(monkeypatch):
    real = scene.make_people

    def identical(*args):
        one = real(*args)[0]
        shifts = [np.array([1.2 * k, 0.4 * k, 0.0]) for k in range(3)]
        return (one, *((lambda times, s=s: one(times) + s) for s in shifts[1:]))

    monkeypatch.setattr(scene, "make_people", identical)
    assert_right_or_not_ok(SceneOptions(n_people=3, n_frames=60, seed=1))


def test_people_who_stand_for_most_of_a_short_clip_tell_the_clocks():
    """Adjacent lags fit alike: registration is five frames off, and noise used to keep it there."""
    scene_ = simulate(SceneOptions(n_people=2, people="alike", n_frames=90, seed=7117))
    calibration = calibrate(scene_.recording)
    e = error(calibration, scene_.truth)
    assert not e.missing
    assert max(abs(camera.offset_frames) for camera in e.cameras) < 0.3


def test_a_camera_that_is_a_step_of_everybody_off_is_put_right():
    """Clips that repeat themselves; the first camera was 35 frames off, a quarter unexplained."""
    options = SceneOptions(seed=2004, keypoint_bias_mm=20.0, line_time_s=1e-6)
    walk = simulate(options, clips=shipped_clips())
    calibration = calibrate(walk.recording)
    assert calibration.status is Status.OK, calibration.message
    assert len(calibration.cameras) == 4
    assert error(calibration, walk.truth).E_delta_s < 0.1 / 30.0
