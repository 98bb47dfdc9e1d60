"""Motion along directions that the keypoints hardly know."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundle_helpers import problem

from stcalib_ros.core.bundle.levenberg_marquardt import PointProblem
from stcalib_ros.core.bundle.motion_filter import (
    depth_variance_ratio,
    motion_filter,
    principal_variances,
)
from stcalib_ros.core.bundle.state import estimate_motion


def side_by_side(distance, seed=0, sigma_px=2.0):
    """Two cameras at a distance along x that look along z, and joints with noise along their views.

    The noise is what keypoints of 2 px leave of the position.
    """
    rng = np.random.default_rng(seed)
    shape = {"cameras": 2, "people": 2, "time_bins": 40, "joints": 4}
    p = problem(rng, **shape, missing=0.0, sigma_px=0.0, pace_m_s=0.5, acceleration=0.5)
    R, t = np.tile(np.eye(3), (2, 1, 1)), np.array([[0, 0, 0], [-distance, 0, 0.0]])
    state = replace(p.truth, R_cam_ref=R, t_cam_ref=t, shift_s=np.zeros(2))
    Y = state.X[:, None] + t[:, None]
    noise = sigma_px * rng.normal(size=p.o.x.shape) / p.o.focal[..., None]
    o = replace(p.o, x=Y[..., :2] / Y[..., 2:] + noise, phi=np.zeros_like(p.o.phi))
    return o, state, rng


@pytest.fixture
def noisy():
    """Observations, a state with the noise of its joints, and the one without."""
    o, truth, rng = side_by_side(0.3)
    variance, axes = principal_variances(o, truth, 2.0)
    noise = (axes @ (np.sqrt(variance) * rng.normal(size=variance.shape))[..., None])[..., 0]
    return o, replace(truth, X=truth.X + noise), truth


def test_depth_is_known_as_badly_as_the_baseline_is_short():
    o, state, _ = side_by_side(0.3)
    variance, axes = principal_variances(o, state, 2.0)
    z = state.X[..., 2]
    predicted = z**2 / (1400 * 0.3) * 2.0 * np.sqrt(2)
    np.testing.assert_allclose(np.sqrt(variance[..., 2]), predicted, rtol=0.25)
    assert (np.abs(axes[..., 2, 2]) > 0.9).all()
    assert (np.diff(variance) >= 0).all()


def test_only_cameras_side_by_side_know_depths_badly():
    assert depth_variance_ratio(*side_by_side(0.3)[:2]) > 100
    around = problem(np.random.default_rng(0), cameras=4, time_bins=20)
    assert depth_variance_ratio(around.o, around.truth) < 10


def test_filtered_motion_is_nearer_to_the_truth_along_the_views(noisy):
    o, state, truth = noisy
    fit = motion_filter(o, state)
    known = state.triangulated()
    V, A = fit(o, state.X, known)
    fine, bend = estimate_motion(o, state.X, known)

    def off(values, true):
        return np.median(np.abs(values - true), axis=(0, 1))

    assert off(V, truth.V)[2] < 0.4 * off(fine, truth.V)[2]
    assert off(A, truth.A)[2] < 0.4 * off(bend, truth.A)[2]
    assert (off(V, truth.V)[:2] < 1.05 * off(fine, truth.V)[:2]).all()


def test_filter_is_linear(noisy):
    o, state, truth = noisy
    fit, known = motion_filter(o, state), state.triangulated()
    V, _ = fit(o, state.X, known)
    W, _ = fit(o, truth.X, known)
    both, _ = fit(o, state.X + truth.X, known)
    np.testing.assert_allclose(both, V + W, atol=1e-6)


def test_settled_points_fit_better_than_those_that_followed_in_a_straight_line(noisy):
    o, state, _ = noisy
    at = PointProblem(o, state, 5.0)
    step = at.apply_step(at.reduce(0.0))
    assert step.settled().cost <= step.cost + 1e-9
    assert step.settled().length == step.length
