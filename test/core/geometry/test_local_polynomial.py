"""Velocities and accelerations of trajectories with gaps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from stcalib_ros.core.geometry.local_polynomial import local_motion

seeds = st.integers(0, 2**32 - 1)


def cubic(rng, n, J=2):
    """Positions, velocities and accelerations (n, J, 3) of a cubic of random coefficients."""
    k = (np.arange(n) - n / 2)[:, None, None]
    c = rng.normal(size=(4, J, 3)) * np.array([1, 0.3, 0.03, 0.003])[:, None, None]
    X = c[0] + c[1] * k + c[2] * k**2 + c[3] * k**3
    V = c[1] + 2 * c[2] * k + 3 * c[3] * k**2
    return X, V, 2 * c[2] + 6 * c[3] * k


def samples_in_window(present):
    n = len(present)
    return np.array([present[max(0, i - 3) : min(n, i + 4)].sum(0) for i in range(n)])


@given(seeds)
def test_a_cubic_without_gaps_is_exact(seed):
    X, V, A = cubic(np.random.default_rng(seed), 20)
    velocity, acceleration = local_motion(X, np.ones(X.shape[:2], dtype=bool))
    inner = slice(6, -6)
    np.testing.assert_allclose(velocity[inner], V[inner], atol=1e-9)
    np.testing.assert_allclose(acceleration[inner], A[inner], atol=1e-9)


@given(seeds)
def test_a_cubic_with_gaps_is_exact_while_four_samples_are_near(seed):
    rng = np.random.default_rng(seed)
    X, V, A = cubic(rng, 40)
    present = rng.uniform(size=X.shape[:2]) < 0.75
    near = samples_in_window(present) >= 4
    velocity, acceleration = local_motion(np.where(present[..., None], X, 1e3), present)
    # A small ridge keeps the higher terms of lonely samples quiet.
    np.testing.assert_allclose(velocity[near], V[near], atol=5e-3)
    np.testing.assert_allclose(acceleration[near], A[near], atol=5e-3)


def test_the_middle_is_the_filter_of_savitzky_and_golay(rng):
    X = rng.normal(size=(30, 4, 3))
    found = local_motion(X, np.ones((30, 4), dtype=bool))
    for order, values in enumerate(found, start=1):
        expected = savgol_filter(X, 13, 7, deriv=order, axis=0)
        np.testing.assert_allclose(values[6:-6], expected[6:-6], atol=1e-12)


def test_beside_gaps_and_ends_it_is_a_cubic_over_half_of_the_window(rng):
    X = rng.normal(size=(40, 1, 3))
    present = np.ones((40, 1), dtype=bool)
    present[20] = False
    cubic_there = [*range(3, 6), *range(14, 17), *range(24, 27), *range(34, 37)]
    for order, values in enumerate(local_motion(X, present), start=1):
        expected = savgol_filter(X, 7, 3, deriv=order, axis=0)
        np.testing.assert_allclose(values[cubic_there], expected[cubic_there], atol=1e-3)


def test_a_swing_of_three_hertz_is_read_to_two_thousandths():
    phase = 2 * np.pi * 3.0 / 30.0 * np.arange(60.0)
    X = np.sin(phase)[:, None, None] * np.ones(3)
    velocity, _ = local_motion(X, np.ones((60, 1), dtype=bool))
    expected = 2 * np.pi * 3.0 / 30.0 * np.cos(phase)[:, None, None]
    assert np.abs(velocity - expected)[6:-6].max() < 0.0021 * np.abs(expected).max()


def test_what_is_not_present_is_not_read(rng):
    X = rng.normal(size=(20, 3, 3))
    present = rng.uniform(size=(20, 3)) < 0.6
    other = np.where(present[..., None], X, 1e6)
    for one, two in zip(local_motion(X, present), local_motion(other, present), strict=True):
        np.testing.assert_array_equal(one, two)


def test_where_nothing_is_near_nothing_moves(rng):
    X = rng.normal(size=(30, 1, 3))
    present = np.zeros((30, 1), dtype=bool)
    present[[4, 25]] = True
    far = samples_in_window(present)[:, 0] == 0
    assert far.sum() == 30 - 14
    for values in local_motion(X, present):
        assert not values[far].any()


def test_a_lonely_sample_stands_still(rng):
    X = rng.normal(size=(15, 1, 3))
    present = np.zeros((15, 1), dtype=bool)
    present[7] = True
    for values in local_motion(X, present):
        np.testing.assert_allclose(values[7], 0, atol=1e-9)


@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_short_trajectories_are_finite(rng, n):
    X = rng.normal(size=(n, 2, 3))
    for values in local_motion(X, np.ones((n, 2), dtype=bool)):
        assert values.shape == X.shape
        assert np.isfinite(values).all()


def test_a_steady_pace_is_read_off_two_neighbours():
    X = np.arange(8.0)[:, None, None] * [[1.0, -2.0, 0.5]]
    present = np.zeros((8, 1), dtype=bool)
    present[[3, 4]] = True
    velocity, _ = local_motion(X, present)
    np.testing.assert_allclose(velocity[[3, 4], 0], [[1.0, -2.0, 0.5]] * 2, rtol=0.03)
