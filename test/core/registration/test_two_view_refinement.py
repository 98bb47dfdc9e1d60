"""Sampson distances and the refinement of two views, against SciPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import EXACT, FRAME_S, lifted, true_rig
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from stcalib_ros.core.geometry.epipolar import sampson
from stcalib_ros.core.geometry.so3 import exp_so3, hat, rotation_angle
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.registration.correspondences import correspondences, white_noise_px
from stcalib_ros.core.registration.two_view_refinement import refine_pair
from stcalib_ros.core.synthetic import simulate

seeds = st.integers(0, 2**32 - 1)


def homogeneous(points):
    return points / points[..., 2:]


def random_views(rng, n=30):
    """Points in two optical frames, and the essential matrix between them."""
    R_a_b, t_a_b = exp_so3(rng.normal(size=3)), rng.normal(size=3)
    x_a = rng.uniform([-1, -1, 3], [1, 1, 6], (n, 3))
    x_b = (x_a - t_a_b) @ R_a_b
    return homogeneous(x_a), x_b / x_b[:, 2:], hat(t_a_b) @ R_a_b


@given(seeds)
def test_exact_matches_have_no_distance(seed):
    x_a, x_b, E = random_views(np.random.default_rng(seed))
    np.testing.assert_allclose(sampson(E, x_a, x_b), 0, atol=1e-9)


@given(seeds, st.floats(0.01, 100))
def test_the_length_of_the_baseline_does_not_matter(seed, factor):
    rng = np.random.default_rng(seed)
    x_a, x_b, E = random_views(rng)
    x_a[:, :2] += 0.01 * rng.normal(size=(30, 2))
    np.testing.assert_allclose(sampson(factor * E, x_a, x_b), sampson(E, x_a, x_b), rtol=1e-6)


def test_the_distance_is_to_first_order_how_far_points_have_to_move(rng):
    x_a, x_b, E = random_views(rng, 8)
    noise = 1e-4 * rng.normal(size=(8, 4))
    x_a[:, :2] += noise[:, :2]
    x_b[:, :2] += noise[:, 2:]
    moved = np.eye(3, 4) * [1, 1, 0, 0]
    for a, b, s in zip(x_a, x_b, sampson(E, x_a, x_b), strict=True):
        found = minimize(
            lambda d: 1e8 * (d**2).sum(),
            np.zeros(4),
            method="SLSQP",
            constraints={
                "type": "eq",
                "fun": lambda d, a=a, b=b: (
                    1e4 * (a + moved @ d) @ E @ (b + moved @ d[[2, 3, 0, 1]])
                ),
            },
            options={"ftol": 1e-12, "maxiter": 200},
        )
        assert np.sqrt(found.fun / 1e8) == pytest.approx(abs(s), rel=1e-2)


@given(seeds, st.floats(0.1, 1.0))
def test_a_point_of_less_noise_counts_as_one_measured_more_finely(seed, noise):
    """Scaling the axes of image b by the noise makes it the ordinary distance."""
    x_a, x_b, E = random_views(np.random.default_rng(seed))
    x_a[:, :2] += 0.01
    finer = np.diag([1 / noise, 1 / noise, 1])
    there = sampson(E @ np.linalg.inv(finer), x_a, x_b @ finer)
    np.testing.assert_allclose(sampson(E, x_a, x_b, noise**2), there, rtol=1e-9)


# Refinement


@pytest.fixture(scope="module")
def subframe():
    """Exact keypoints, clocks off by fractions of a frame, poses off by their usual errors.

    And the truth of a pair.
    """
    poses = {"lifter_mm": (45, 45), "tilt_deg": 3, "crop_perspective": 1}
    scene = simulate(replace(EXACT, max_offset_frames=4, seed=3, **poses))
    rig = true_rig(scene)
    persons = [
        {int(own[0]): i for i, own in enumerate(scene.track_persons[c.name].values())}
        for c in scene.recording.cameras
    ]
    truth = RelativePose(
        0,
        1,
        rig.R_ref_cam[1],
        rig.t_ref_cam[1],
        float(-rig.offset_s[1]),
        tuple((persons[0][p], persons[1][p]) for p in persons[0] if p in persons[1]),
        1.0,
    )
    return lifted(scene.recording)[1], truth


def disturbed(h, *, degrees, frames, seed=0):
    rng = np.random.default_rng(seed)
    turn = rng.normal(size=(2, 3))
    turn *= np.radians(degrees) / np.linalg.norm(turn, axis=-1, keepdims=True)
    return replace(
        h,
        R_a_b=exp_so3(turn[0]) @ h.R_a_b,
        t_a_b=exp_so3(turn[1]) @ h.t_a_b,
        lag_s=h.lag_s + frames * FRAME_S,
    )


def direction_error(h, truth):
    cosine = h.t_a_b @ truth.t_a_b / np.linalg.norm(h.t_a_b) / np.linalg.norm(truth.t_a_b)
    return float(np.arccos(np.clip(cosine, -1, 1)))


@pytest.mark.parametrize("seed", range(4))
def test_rotation_direction_and_lag_between_frames_are_recovered(subframe, seed):
    cameras, truth = subframe
    refined = refine_pair(cameras, disturbed(truth, degrees=2, frames=1.3, seed=seed))
    # Images are read off between frames linearly.
    assert rotation_angle(refined.R_a_b.T @ truth.R_a_b) < 3e-3
    assert direction_error(refined, truth) < 3e-3
    assert abs(refined.lag_s - truth.lag_s) < 0.05 * FRAME_S
    assert np.linalg.norm(refined.t_a_b) == pytest.approx(np.linalg.norm(truth.t_a_b), rel=0.01)
    assert refined.epipolar_px < 0.5


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


def test_the_truth_stays(subframe):
    cameras, truth = subframe
    refined = refine_pair(cameras, truth)
    assert rotation_angle(refined.R_a_b.T @ truth.R_a_b) < 5e-4
    assert abs(refined.lag_s - truth.lag_s) < 0.02 * FRAME_S


def test_people_behind_the_cameras_support_nothing(subframe):
    cameras, truth = subframe
    assert refine_pair(cameras, replace(truth, t_a_b=-truth.t_a_b)).support < 0.01 * (
        refine_pair(cameras, truth).support
    )


def scipy_optimum(cameras, refined):
    """Minimum of the same robust cost, found without derivatives from where the refined is."""
    c = correspondences(cameras, refined)
    at_optimum = sampson(hat(refined.t_a_b) @ refined.R_a_b, c.x_a, c.x_b) * c.focal
    deviation = 1.48 * np.median(np.abs(at_optimum))
    white = min(1, (white_noise_px(cameras[1].tracks) / deviation) ** 2)
    tangent = np.linalg.svd(refined.t_a_b[None])[2][1:]

    def unpack(v):
        t = exp_so3(tangent.T @ v[3:5]) @ (refined.t_a_b / np.linalg.norm(refined.t_a_b))
        return exp_so3(v[:3]) @ refined.R_a_b, t, refined.lag_s + v[5] * FRAME_S

    scale = max(3.0, 1.5 * deviation)

    def cost(v):
        R, t, lag_s = unpack(v)
        x = correspondences(cameras, replace(refined, lag_s=lag_s))
        r = sampson(hat(t) @ R, x.x_a, x.x_b, 1 - white * (1 - x.variance_b)) * x.focal
        return np.log1p((r / scale) ** 2).mean()

    best = minimize(cost, np.zeros(6), method="Nelder-Mead", options={"maxfev": 900, "xatol": 1e-5})
    return cost(np.zeros(6)), best.fun


def test_refinement_reaches_the_optimum_of_its_cost():
    scene = simulate(replace(EXACT, max_offset_frames=4, seed=3, sigma_px=3.0, n_frames=40))
    _, cameras = lifted(scene.recording)
    rig = true_rig(scene)
    truth = RelativePose(
        0, 1, rig.R_ref_cam[1], rig.t_ref_cam[1], -rig.offset_s[1], ((0, 0), (1, 1), (2, 2)), 1.0
    )
    start = disturbed(truth, degrees=3, frames=0.5)
    refined = refine_pair(cameras, start)
    reached, best = scipy_optimum(cameras, refined)
    assert reached < best + 2e-3 * abs(best)


def test_too_few_points_are_not_refined(subframe):
    cameras, truth = subframe
    short = tuple(replace(c, tracks=tuple(track[:2] for track in c.tracks)) for c in cameras)
    assert refine_pair(short, replace(truth, matches=truth.matches[:1])) is None


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
