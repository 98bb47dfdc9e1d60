"""Stamps put at even times."""

from __future__ import annotations

import numpy as np
import pytest

from stcalib_ros.core.final.regular import even_times


@pytest.mark.parametrize("seconds", [10.0, 40.0])
@pytest.mark.parametrize("fps", [25.0, 59.94])
def test_jitter_is_found_where_images_are_even(rng, fps, seconds):
    true = np.arange(int(fps * seconds)) / fps
    true = true[rng.uniform(size=len(true)) > 0.1]
    stamps = 7.3 + true + 0.003 * np.clip(rng.standard_normal(len(true)), -2, 2)
    correction = even_times(stamps)
    left = (stamps + correction - true) - (stamps - true).mean()
    assert np.abs(left).max() < 1e-3
    assert correction.mean() == pytest.approx(0.0, abs=1e-9)


def test_even_stamps_stay():
    np.testing.assert_allclose(even_times(np.arange(200) / 30.0), 0.0, atol=1e-9)


def test_stamps_of_uneven_images_stay(rng):
    np.testing.assert_array_equal(even_times(np.cumsum(rng.exponential(1 / 30, 300))), 0.0)


@pytest.mark.parametrize("n", [0, 1, 5])
def test_a_few_stamps_stay(n):
    np.testing.assert_array_equal(even_times(np.arange(n) / 30.0), np.zeros(n))
