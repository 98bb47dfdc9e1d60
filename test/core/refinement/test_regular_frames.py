"""Stamps put at even times."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from stcalib_ros.core.refinement.regular_frames import regular_times


@pytest.mark.parametrize("seconds", [10.0, 40.0])
@pytest.mark.parametrize("fps", [25.0, 59.94])
def test_jitter_is_found_where_images_are_even(rng, fps, seconds):
    true = np.arange(int(fps * seconds)) / fps
    true = true[rng.uniform(size=len(true)) > 0.1]
    stamps = 7.3 + true + 0.003 * np.clip(rng.standard_normal(len(true)), -2, 2)
    correction = regular_times(stamps)
    left = (stamps + correction - true) - (stamps - true).mean()
    assert np.abs(left).max() < 1e-3
    assert correction.mean() == pytest.approx(0.0, abs=1e-9)


def test_jitter_of_a_third_of_a_period_mixes_up_no_images(rng):
    true = np.sort(rng.choice(900, 810, replace=False)) / 60.0
    stamps = true + 0.005 * rng.standard_normal(len(true))
    stamps = np.maximum.accumulate(stamps + 1e-6 * np.arange(len(stamps)))
    correction = regular_times(stamps)
    left = stamps + correction - true
    left -= np.median(left)
    # Where images are lost beside a large error, a number may be one off.
    assert (np.abs(left) < 1e-3).mean() > 0.8
    assert left.std() < 0.8 * (stamps - true).std()


def test_even_stamps_stay():
    np.testing.assert_allclose(regular_times(np.arange(200) / 30.0), 0.0, atol=1e-9)


def test_stamps_of_uneven_images_stay(rng):
    np.testing.assert_array_equal(regular_times(np.cumsum(rng.exponential(1 / 30, 300))), 0.0)


def test_a_thousand_images_a_second_take_little_memory(rng):
    true = np.sort(rng.choice(15_000, 14_000, replace=False)) / 1000.0
    stamps = true + 1e-4 * rng.standard_normal(len(true))
    tracemalloc.start()
    correction = regular_times(stamps)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # The phases of all rates at once would be 6 GB.
    assert peak < 200e6
    left = stamps + correction - true
    assert np.abs(left - left.mean()).max() < 2e-5


@pytest.mark.parametrize("n", [0, 1, 5])
def test_a_few_stamps_stay(n):
    np.testing.assert_array_equal(regular_times(np.arange(n) / 30.0), np.zeros(n))
