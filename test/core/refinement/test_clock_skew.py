"""Clock rates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import SMALL, changed

from stcalib_ros.core.options import Options
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.mocap import shipped_clips


@pytest.fixture(scope="module")
def minute():
    """Truth and result of a minute with clocks that are off by up to 50 ppm."""
    options = SceneOptions(
        n_frames=1800, n_cameras=3, n_people=2, skew_ppm=50.0, id_switches_per_10s=0, seed=1
    )
    scene = simulate(options, clips=shipped_clips())
    return scene.truth, calibrate(scene.recording)


def test_rates_are_found_in_a_minute(minute):
    truth, found = minute
    for true, camera in zip(truth.cameras[1:], found.cameras[1:], strict=True):
        assert abs(true.clock_skew) > 25e-6
        assert camera.clock_skew == pytest.approx(true.clock_skew, abs=10e-6)
        assert 0.0 < camera.clock_skew_stddev <= 10e-6


def test_offsets_hold_for_the_epoch(minute):
    truth, found = minute
    assert found.epoch_s == pytest.approx(truth.epoch_s)
    for true, camera in zip(truth.cameras[1:], found.cameras[1:], strict=True):
        error = abs(camera.time_offset_s - true.time_offset_s)
        assert error < 4.0 * camera.time_offset_stddev_s
        # Of the offset in the middle alone, without the rate, the error would be 1 ms and more.
        assert error < 4e-4
        assert camera.time_offset_stddev_s > 25.0 * camera.clock_skew_stddev


@pytest.mark.parametrize("name", ["cam0", "cam2"])
def test_a_rate_of_29_97_is_found_in_ten_seconds(name):
    """Of the reference as well: then all others have it, the other way round."""
    scene = simulate(SceneOptions(n_cameras=3, n_people=2, seed=9303), clips=shipped_clips())

    def faster(camera):
        first = camera.stamps[0]
        return replace(camera, stamps=first + (camera.stamps - first) * (1.0 - 1e-3))

    found = calibrate(changed(scene.recording, name, faster), Options(offset_range_s=1.0))
    for camera in found.cameras[1:]:
        true = {"cam0": -1e-3, camera.name: 1e-3}.get(name, 0.0)
        assert camera.clock_skew == pytest.approx(true, abs=1.5e-4)
        assert camera.clock_skew_stddev > 10e-6


def test_rates_are_refused_where_the_recording_is_short(small_stages):
    reference, *others = small_stages.calibration.cameras
    assert (reference.clock_skew, reference.clock_skew_stddev) == (0.0, 0.0)
    for camera in others:
        assert camera.clock_skew == 0.0
        assert 10e-6 < camera.clock_skew_stddev < 1e-2


def test_rates_of_synchronised_clocks_are_not_asked_for():
    scene = simulate(replace(SMALL, max_offset_frames=0))
    found = calibrate(scene.recording, Options(offset_range_s=0.0))
    assert all(np.isnan(camera.clock_skew_stddev) for camera in found.cameras)
    assert not any(camera.clock_skew for camera in found.cameras)
