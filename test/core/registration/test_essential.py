"""From essential matrices to poses, with outliers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import FRAME_S
from epipolar_helpers import FOCAL_PX, direction_error, matrix_error, random_views
from hypothesis import given
from hypothesis import strategies as st

from stcalib_ros.core.geometry.epipolar import decompose_essential
from stcalib_ros.core.geometry.so3 import exp_so3, hat, rotation_angle
from stcalib_ros.core.registration.correspondences import Correspondences, correspondences
from stcalib_ros.core.registration.epipolar_correlation import best_essential, noise_of_moments
from stcalib_ros.core.registration.essential import pose_by_cheirality, robust_essential

seeds = st.integers(0, 2**32 - 1)


def common(x_a, x_b):
    n = len(x_a)
    unknown = np.full(n, np.nan)
    focal = np.full(n, FOCAL_PX)
    return Correspondences(x_a, x_b, 0 * x_b, 0 * unknown, 0 * unknown, focal, unknown, unknown)


@given(seeds, st.sampled_from([1.0, -1.0]))
def test_most_points_ahead_of_both_cameras_decide_among_four_poses(seed, sign):
    x_a, x_b, E = random_views(np.random.default_rng(seed))
    R, t = pose_by_cheirality(sign * E, common(x_a, x_b))
    np.testing.assert_allclose(hat(t) @ R, E, atol=1e-6)
    assert any(np.allclose(R, R_) and np.allclose(t, t_) for R_, t_ in decompose_essential(E))


def test_a_quarter_of_wrong_points_is_not_followed():
    """Its errors are those without them, not those of least squares with them."""
    errors = []
    for seed in range(15):
        rng = np.random.default_rng(seed)
        x_a, x_b, E = random_views(rng, 1000)
        for x in (x_a, x_b):
            x[:, :2] += rng.normal(size=(1000, 2)) / FOCAL_PX
        x_b[:250, :2] += rng.uniform(-100, 100, (250, 2)) / FOCAL_PX
        start = E + 0.005 * rng.normal(size=(3, 3))
        products = (x_a[:, :, None] * x_b[:, None, :]).reshape(-1, 9)
        plain = best_essential(products.T @ products, noise_of_moments(x_a.T @ x_a, x_b.T @ x_b))
        found = (
            robust_essential(start, common(x_a, x_b)),
            robust_essential(start, common(x_a[250:], x_b[250:])),
            plain[1],
        )
        errors.append([matrix_error(one, E) for one in found])
    robust, without, plain = np.median(errors, axis=0)
    assert robust < 2 * without
    assert robust < 0.1 * plain


@pytest.mark.parametrize("degrees", [0.0, 2.0, 5.0])
def test_the_pose_of_a_pair_is_found_from_a_matrix_nearby(subframe, degrees, rng):
    cameras, truth = subframe
    c = correspondences(cameras, truth)
    turned = exp_so3(np.radians(degrees) / np.sqrt(3) * np.ones(3)) @ truth.R_a_b
    E = robust_essential(hat(truth.t_a_b) @ turned, c)
    R, t = pose_by_cheirality(E, c)
    assert rotation_angle(R.T @ truth.R_a_b) < 3e-3
    assert direction_error(t, truth.t_a_b) < 3e-3


def test_a_lag_that_is_off_by_a_frame_turns_it_a_little(subframe):
    cameras, truth = subframe
    errors = []
    for frames in (0.0, 1.0):
        c = correspondences(cameras, replace(truth, lag_s=truth.lag_s + frames * FRAME_S))
        R, _ = pose_by_cheirality(robust_essential(hat(truth.t_a_b) @ truth.R_a_b, c), c)
        errors.append(rotation_angle(R.T @ truth.R_a_b))
    assert errors[0] < errors[1] < 0.1
