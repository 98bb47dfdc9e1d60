"""Keypoints of matched tracks at the same times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import EXACT, FRAME_S, lifted
from epipolar_helpers import STEP_S, camera_of, track_of

from stcalib_ros.core.geometry.epipolar import sampson
from stcalib_ros.core.geometry.so3 import hat
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.registration.correspondences import correspondences, white_noise_px
from stcalib_ros.core.synthetic import simulate


def test_noise_that_is_new_in_every_image_is_told_from_motion_and_from_noise_that_stays(rng):
    scene = simulate(replace(EXACT, max_offset_frames=4, seed=3))
    camera = lifted(scene.recording)[1][0]

    def noisy(track):
        new = rng.normal(size=track.x.shape)
        stays = rng.normal(size=(1, *track.x.shape[1:]))
        return replace(track, x=track.x + (2 * new + 5 * stays) / track.focal[..., None])

    assert white_noise_px(camera.tracks) < 0.1
    assert white_noise_px([noisy(t) for t in camera.tracks]) == pytest.approx(2, rel=0.05)
    assert white_noise_px([replace(t, frames=2 * t.frames) for t in camera.tracks]) == 0


def test_correspondences_are_thinned_to_about_the_number_asked_for(subframe):
    cameras, truth = subframe
    n = len(correspondences(cameras, truth, max_points=10**9).x_a)
    thin = len(correspondences(cameras, truth, max_points=1000).x_a)
    assert n > 3000
    assert 500 < thin <= 1100


def test_correspondences_at_the_true_lag_satisfy_the_epipolar_constraint(subframe):
    cameras, truth = subframe
    c = correspondences(cameras, truth)
    r = sampson(hat(truth.t_a_b) @ truth.R_a_b, c.x_a, c.x_b) * c.focal
    # What is left is the curvature of image paths between two frames.
    assert np.median(np.abs(r)) < 0.2
    wrong = correspondences(cameras, replace(truth, lag_s=truth.lag_s + 2 * FRAME_S))
    r = sampson(hat(truth.t_a_b) @ truth.R_a_b, wrong.x_a, wrong.x_b) * wrong.focal
    assert np.median(np.abs(r)) > 2


def test_velocities_are_those_of_the_points(subframe):
    cameras, truth = subframe
    h = 1e-5
    c = correspondences(cameras, truth)
    later = correspondences(cameras, replace(truth, lag_s=truth.lag_s + h))
    np.testing.assert_allclose((later.x_b - c.x_b) / h, c.v_b, atol=1e-6)


def steady(rng, n=20, joints=5):
    """A track whose joints move at their own steady velocities, and these per second."""
    start, velocity = rng.normal(size=(2, joints, 2))
    x = start + (np.arange(n) * STEP_S)[:, None, None] * velocity
    return track_of(x), velocity


def hypothesis_of(lag_s, matches=((0, 0),)):
    return RelativePose(0, 1, np.eye(3), np.array([1.0, 0.0, 0.0]), lag_s, matches, 1.0)


@pytest.mark.parametrize("frames", [0.0, 2.0, -3.4, 5.25])
def test_keypoints_are_read_off_between_images(rng, frames):
    (a, _), (b, velocity) = steady(rng), steady(rng)
    c = correspondences([camera_of([a]), camera_of([b])], hypothesis_of(frames * STEP_S))
    n_inside = np.floor(19 - abs(frames)) + 1
    assert c.x_a.shape == c.x_b.shape == (5 * n_inside, 3)
    np.testing.assert_array_equal(c.x_a[:, 2], 1.0)
    first = max(0.0, frames)
    offset = first if frames >= 0 else frames + np.ceil(-frames)
    np.testing.assert_allclose(c.x_b[:5, :2], b.x[0] + offset * STEP_S * velocity, atol=1e-12)
    for v_b in c.v_b.reshape(-1, 5, 3):
        np.testing.assert_allclose(v_b[:, :2], velocity, rtol=1e-9)
    u = frames % 1.0
    np.testing.assert_allclose(c.variance_b, u**2 + (1 - u) ** 2, atol=1e-9)


def test_what_one_of_both_does_not_observe_is_left_out(rng):
    (a, _), (b, _) = steady(rng), steady(rng)
    a.x[3, 1], b.x[7, 2], b.x[3, 1] = np.nan, np.nan, np.nan
    c = correspondences([camera_of([a]), camera_of([b])], hypothesis_of(0.5 * STEP_S))
    # Between two images both are needed: two times of each of the joints.
    assert len(c.x_a) == 19 * 5 - 4
    assert np.isfinite(np.hstack([c.x_a, c.x_b, c.v_b])).all()


def test_every_match_contributes_and_depths_belong_to_their_images(rng):
    tracks = [steady(rng)[0] for _ in range(4)]
    near = [
        replace(t, root_cam=np.tile([0.0, 0.0, float(k)], (20, 1))) for k, t in enumerate(tracks)
    ]
    cameras = [camera_of(near[:2]), camera_of(near[2:])]
    c = correspondences(cameras, hypothesis_of(0.0, ((0, 1), (1, 0))))
    np.testing.assert_array_equal(c.depth_a, np.repeat([0.0, 1.0], 100))
    np.testing.assert_array_equal(c.depth_b, np.repeat([3.0, 2.0], 100))
