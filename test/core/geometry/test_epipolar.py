"""Sampson distances against SciPy; the poses of an essential matrix."""

from __future__ import annotations

import numpy as np
import pytest
from epipolar_helpers import direction_error, projected, random_views
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from stcalib_ros.core.geometry.epipolar import decompose_essential, depths, sampson
from stcalib_ros.core.geometry.so3 import exp_so3, hat, rotation_angle

seeds = st.integers(0, 2**32 - 1)


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


@given(seeds, st.floats(-5, 5).filter(lambda factor: abs(factor) > 0.1))
def test_one_of_the_four_poses_is_the_true_one(seed, factor):
    rng = np.random.default_rng(seed)
    R, t = exp_so3(rng.normal(size=3)), rng.normal(size=3)
    found = decompose_essential(factor * hat(t) @ R)
    assert len(found) == 4
    for R_a_b, t_a_b in found:
        np.testing.assert_allclose(R_a_b.T @ R_a_b, np.eye(3), atol=1e-12)
        assert np.linalg.det(R_a_b) == pytest.approx(1)
        assert np.linalg.norm(t_a_b) == pytest.approx(1)
    errors = [max(rotation_angle(R_.T @ R), direction_error(t_, t)) for R_, t_ in found]
    assert sorted(errors)[0] < 1e-6
    assert sorted(errors)[1] > 1e-2


@given(seeds)
def test_depths_are_those_of_the_points(seed):
    rng = np.random.default_rng(seed)
    R, t = exp_so3(0.3 * rng.normal(size=3)), rng.normal(size=3)
    X_a = rng.uniform([-1, -1, 3], [1, 1, 6], (20, 3))
    X_b = (X_a - t) @ R
    depth_a, depth_b = depths(R, t, projected(X_a), projected(X_b))
    np.testing.assert_allclose(depth_a, X_a[:, 2], rtol=1e-5)
    np.testing.assert_allclose(depth_b, X_b[:, 2], rtol=1e-5, atol=1e-9)


@given(seeds)
def test_against_the_other_way_everything_is_behind(seed):
    rng = np.random.default_rng(seed)
    R, t = exp_so3(0.3 * rng.normal(size=3)), rng.normal(size=3)
    x_a, x_b = rng.normal(size=(2, 20, 3))
    there, back = depths(R, t, x_a, x_b), depths(R, -t, x_a, x_b)
    np.testing.assert_allclose(there, -np.array(back), rtol=1e-9)
