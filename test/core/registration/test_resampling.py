"""Samples at irregular times read off at others, gaps left open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import FRAME_S
from hypothesis import given
from hypothesis import strategies as st

from stcalib_ros.core.geometry.interpolation import Interpolation, frame_period, frame_rate
from stcalib_ros.core.registration.resampling import common_step, joints_centre, sample_camera

seeds = st.integers(0, 2**32 - 1)


@given(seeds, st.floats(-3, 3), st.floats(-3, 3))
def test_linear_signals_are_exact(seed, slope, value):
    rng = np.random.default_rng(seed)
    stamps = np.cumsum(rng.uniform(0.5, 1.5, 20))
    times = rng.uniform(stamps[0], stamps[-1], 30)
    at = Interpolation(stamps, times, period=1.0)
    signal = value + slope * stamps[:, None]
    np.testing.assert_allclose(at(signal), value + slope * times[:, None], atol=1e-9)
    np.testing.assert_allclose(at.both(signal)[1], slope, atol=1e-9)


def test_samples_themselves_are_returned():
    stamps = np.array([0.0, 1.0, 2.5, 3.0])
    values = np.array([[3.0], [1.0], [4.0], [1.0]])
    np.testing.assert_allclose(Interpolation(stamps, stamps, period=1.0)(values), values)


def test_gaps_are_not_bridged_and_nothing_is_known_outside():
    stamps = np.array([0.0, 1.0, 2.0, 5.0, 6.0])
    times = np.array([-0.1, 0.5, 1.5, 2.1, 3.5, 4.9, 5.5, 6.1])
    at = Interpolation(stamps, times, period=1.0)
    expected = [np.nan, 0.5, 1.5, np.nan, np.nan, np.nan, 5.5, np.nan]
    np.testing.assert_allclose(at(stamps), expected)
    np.testing.assert_array_equal(np.isfinite(at.both(stamps)[1]), np.isfinite(expected))


def test_an_unknown_sample_makes_its_neighbourhood_unknown():
    at = Interpolation(np.arange(4.0), np.array([0.5, 1.5, 2.5]), period=1.0)
    np.testing.assert_allclose(at(np.array([0.0, 1.0, np.nan, 3.0])), [0.5, np.nan, np.nan])


@pytest.mark.parametrize("time", [0.9, 1.0, 1.1])
def test_one_sample_is_no_interval(time):
    at = Interpolation(np.array([1.0]), np.array([time]), period=1.0)
    assert np.isnan(at(np.array([5.0]))).all()
    assert np.isnan(at.both(np.array([5.0]))[1]).all()


def test_the_frame_rate_leaves_out_lost_images_and_gaps(rng):
    stamps = np.arange(0, 60, 1 / 30)
    kept = stamps[rng.random(len(stamps)) > 0.1]
    assert frame_rate(kept[(kept < 20) | (kept > 40)]) == pytest.approx(30.0)
    assert frame_rate(kept + rng.normal(0, 0.002, len(kept))) == pytest.approx(30.0, rel=0.03)


def test_the_frame_rate_is_that_of_images_a_second():
    of_15_hz = np.arange(0, 20, 1 / 15)
    ten_a_second = of_15_hz[np.flatnonzero(np.diff(np.floor(of_15_hz * 10 + 1e-6), prepend=-1))]
    assert frame_rate(ten_a_second) == pytest.approx(10.0, rel=0.01)
    bunches = np.ravel(np.arange(0, 20, 0.3)[:, None] + [0.0, 0.005, 0.01])
    assert frame_rate(bunches) == pytest.approx(10.0, rel=0.05)


@pytest.mark.parametrize("stamps", [[], [1.0]])
def test_one_image_has_no_rate(stamps):
    assert frame_rate(np.array(stamps)) == 0.0


def test_the_frame_period_is_that_of_most_images(rng):
    stamps = np.arange(100) * 0.04
    kept = np.sort(rng.permutation(100)[:80])
    assert frame_period(stamps[kept]) == pytest.approx(0.04)
    assert frame_period(stamps[:1]) == np.inf
    assert frame_period(stamps[:0]) == np.inf


# Cameras on a grid


@pytest.fixture(scope="module")
def sampled(exact_lifted):
    skeleton, cameras = exact_lifted
    return sample_camera(cameras[0], skeleton, start=0.0, step=FRAME_S, n=80)


def test_arrays_are_by_track_sample_and_direction(exact_lifted, sampled):
    P = len(exact_lifted[1][0].tracks)
    assert sampled.oriented.shape == (P, 80, 19, 3)
    assert sampled.weight.shape == (P, 80, 19)
    assert sampled.position.shape == (P, 80, 3)
    assert sampled.present.shape == (P, 80)


def test_oriented_points_are_unit_bones_times_the_root_of_their_length(exact_lifted, sampled):
    skeleton, cameras = exact_lifted
    track = cameras[0].tracks[0]
    bones = np.einsum("dj,fjk->fdk", skeleton.directions, track.joints_cam)
    length = np.linalg.norm(bones, axis=-1)
    unit = bones / length[..., None]
    weight = np.sqrt(np.median(length, axis=0))
    np.testing.assert_allclose(sampled.oriented[0, track.frames], unit * weight[:, None], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(sampled.oriented, axis=-1), sampled.weight, atol=1e-6)


def test_where_nobody_is_there_is_nothing(exact_lifted):
    skeleton, cameras = exact_lifted
    late = sample_camera(cameras[0], skeleton, start=-10 * FRAME_S, step=FRAME_S, n=20)
    assert not late.present[:, :10].any()
    assert not late.oriented[:, :10].any()
    assert not late.weight[:, :10].any()
    assert np.isnan(late.position[:, :10]).all()
    assert late.present[:, 10:].any()


def test_the_grid_is_by_the_clock_of_the_camera(exact_lifted):
    skeleton, cameras = exact_lifted
    camera = replace(cameras[0], stamps=cameras[0].stamps + 5.0)
    shifted = sample_camera(camera, skeleton, start=5.0, step=FRAME_S, n=80)
    plain = sample_camera(cameras[0], skeleton, start=0.0, step=FRAME_S, n=80)
    np.testing.assert_allclose(shifted.oriented, plain.oriented, atol=1e-6)


def test_a_camera_without_tracks_has_empty_arrays(exact_lifted):
    skeleton, cameras = exact_lifted
    nobody = sample_camera(replace(cameras[0], tracks=()), skeleton, start=0.0, step=FRAME_S, n=10)
    assert nobody.oriented.shape == (0, 10, 19, 3)
    assert nobody.present.shape == (0, 10)


def test_a_missing_joint_takes_only_its_own_bones(exact_lifted):
    skeleton, cameras = exact_lifted
    knee = skeleton.layout.index("left_knee")
    track = cameras[0].tracks[0]
    joints = track.joints_cam.copy()
    joints[:, knee] = np.nan
    camera = replace(cameras[0], tracks=(replace(track, joints_cam=joints),))
    weight = sample_camera(camera, skeleton, start=0.0, step=FRAME_S, n=40).weight[0]
    np.testing.assert_array_equal((weight == 0).all(0), skeleton.directions[:, knee] != 0)


def test_the_middle_of_the_body_is_that_of_hips_and_shoulders(exact_lifted):
    skeleton, cameras = exact_lifted
    joints = cameras[0].tracks[0].joints_cam
    trunk = [
        skeleton.layout.index(f"{side}_{joint}")
        for side in ("left", "right")
        for joint in ("hip", "shoulder")
    ]
    np.testing.assert_allclose(joints_centre(joints, skeleton), joints[:, trunk].mean(1))


def test_the_step_is_the_median_of_the_periods(exact_lifted):
    _, cameras = exact_lifted
    usual = cameras[0]
    slow, slowest = (replace(cameras[1], stamps=n * cameras[1].stamps) for n in (2, 3))
    assert common_step([slow, usual]) == pytest.approx(2 * FRAME_S)
    assert common_step([slow]) == pytest.approx(2 * FRAME_S)
    assert common_step([usual, slow, usual]) == pytest.approx(FRAME_S)
    assert common_step([usual, slowest, slow, usual]) == pytest.approx(2 * FRAME_S)


def test_between_two_samples_there_is_less_noise():
    at = Interpolation(np.arange(0.0, 6.0, 2.0), np.array([0.0, 1.0, 2.5, 4.0]), period=2.0)
    np.testing.assert_allclose(at.variance[0], [1, 1 / 2, 0.75**2 + 0.25**2, 1])
    np.testing.assert_allclose(at.variance[1], [-1, 0, -0.5, 1])
