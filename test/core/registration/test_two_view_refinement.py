"""The refinement of two views, against SciPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import EXACT, FRAME_S, lifted, true_rig
from epipolar_helpers import direction_error
from scipy.optimize import minimize

from stcalib_ros.core.geometry.epipolar import sampson
from stcalib_ros.core.geometry.so3 import exp_so3, hat, rotation_angle
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.registration.correspondences import correspondences, white_noise_px
from stcalib_ros.core.registration.two_view_refinement import refine_pair
from stcalib_ros.core.synthetic import simulate


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


@pytest.mark.parametrize("seed", range(4))
def test_rotation_direction_and_lag_between_frames_are_recovered(subframe, seed):
    cameras, truth = subframe
    refined = refine_pair(cameras, disturbed(truth, degrees=2, frames=1.3, seed=seed))
    # Images are read off between frames linearly.
    assert rotation_angle(refined.R_a_b.T @ truth.R_a_b) < 3e-3
    assert direction_error(refined.t_a_b, truth.t_a_b) < 3e-3
    assert abs(refined.lag_s - truth.lag_s) < 0.05 * FRAME_S
    assert np.linalg.norm(refined.t_a_b) == pytest.approx(np.linalg.norm(truth.t_a_b), rel=0.01)
    assert refined.epipolar_px < 0.5


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
