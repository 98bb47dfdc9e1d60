"""A camera with its lens free, against the people that the others see."""

from __future__ import annotations

import numpy as np
import pytest

from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.reconstruction.free_lens import (
    LENS,
    Sighting,
    as_given,
    fit_lens,
    sighting,
    start_from_projection,
)

R = exp_so3(np.array([0.1, 0.2, -0.1]))
T = np.array([0.1, 0.0, 4.0])
FOCAL_PX = 1000.0


def seen(rng, lens, *, sigma_px=1.0, n=600):
    """Keypoints of a lens, of joints 40 ms after the times that their images are said to have."""
    X, V = rng.uniform(-1, 1, (n, 3)), rng.normal(size=(n, 3))
    Z = (X + 0.04 * V) @ R.T + T
    u = Z[:, :2] / Z[:, 2:]
    gain = np.exp(lens[0] + lens[1] * np.array([1, -1]))
    x = gain * u * (1 + lens[4] * (u**2).sum(1, keepdims=True)) + lens[2:4]
    x += rng.normal(0, sigma_px / FOCAL_PX, x.shape)
    return Sighting(X, V, x, np.full(n, FOCAL_PX), np.arange(n))


@pytest.mark.parametrize(
    "lens",
    [
        np.zeros(5),
        np.array([0.2, 0.05, -0.1, 0.05, 0.0]),
        np.array([-0.1, 0.0, 0.0, 0.1, -0.2]),
    ],
)
def test_pose_time_and_lens_are_found(rng, lens):
    fit = fit_lens(seen(rng, lens), as_given(R, T), radial=True)
    deviations = (fit.lens - lens) / fit.stddev
    assert np.abs(deviations).max() < 4
    assert fit.stddev.max() < 0.05
    assert fit.late_s == pytest.approx(0.04, abs=1e-3)
    np.testing.assert_allclose(fit.t_cam_ref, T, atol=0.05)


def test_distortion_stays_where_it_is_not_free(rng):
    fit = fit_lens(seen(rng, np.array([0.1, 0, 0, 0, -0.2])), as_given(R, T), radial=False)
    assert fit.lens[LENS.index("radial")] == 0
    assert np.isinf(fit.stddev[LENS.index("radial")])


def test_a_lens_that_is_far_off_is_found_by_a_projection_matrix(rng):
    lens = np.array([-1.1, 0.0, -0.45, -0.25, 0.0])
    points = seen(rng, lens)
    start = start_from_projection(points)
    assert start is not None
    fit = fit_lens(points, start, radial=False)
    np.testing.assert_allclose(fit.lens, lens, atol=0.02)


def test_errors_that_are_common_to_many_keypoints_are_less_certain(rng):
    lens = np.zeros(5)
    alone = seen(rng, lens, n=800)
    shift = np.repeat(rng.normal(0, 5 / FOCAL_PX, (40, 2)), 20, axis=0)
    number = np.repeat(np.arange(40), 20)
    common = Sighting(alone.X, alone.V, alone.x + shift, alone.focal, number)
    one = fit_lens(common, as_given(R, T), radial=False)
    other = fit_lens(
        Sighting(alone.X, alone.V, alone.x + shift, alone.focal, np.arange(800)),
        as_given(R, T),
        radial=False,
    )
    assert one.stddev[0] > 1.3 * other.stddev[0]


def test_two_cameras_see_nothing_of_each_other(small_stages):
    last = small_stages.iterations[-1]
    obs, state = last.observations, last.state
    assert sighting(obs, state, 0) is not None
    lonely = state.with_inliers(state.inlier & (np.arange(state.inlier.shape[1]) < 2)[:, None])
    assert sighting(obs, lonely, 0) is None
