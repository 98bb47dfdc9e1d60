"""Steps, ramps and stretches in series with noise."""

from __future__ import annotations

import numpy as np
import pytest

from stcalib_ros.core.validation.block_contrast import largest_contrast

TIMES = np.arange(20.0)


def found(x, *, information=1.0, least=0.01, one_border=False):
    x = np.asarray(x, dtype=float).reshape(len(TIMES), -1)
    known = np.broadcast_to(np.eye(x.shape[1]) * information, (len(x), x.shape[1], x.shape[1]))
    return largest_contrast(TIMES, x, known, least_inflation=least, one_border=one_border)


@pytest.mark.parametrize(("first", "last"), [(0, 1), (0, 7), (12, 20), (19, 20), (5, 11)])
def test_a_stretch_is_found(rng, first, last):
    x = 0.1 * rng.standard_normal(20)
    x[first:last] += 2.0
    one = found(x)
    inside = np.zeros(20, bool)
    inside[one.begin : one.end] = True
    rest = ~inside
    assert np.flatnonzero(inside if inside.sum() == last - first else rest).tolist() == list(
        range(first, last)
    )
    assert one.size == pytest.approx(2.0, abs=0.25)
    assert one.significance > 100.0


def test_one_sample_amid_others_is_an_outlier(rng):
    x = 0.1 * rng.standard_normal(20)
    x[8] += 2.0
    assert found(x).significance < 60.0


@pytest.mark.parametrize("size", [1, 3])
def test_noise_alone_is_never_significant(rng, size):
    largest = max(
        found(rng.standard_normal((20, size)), least=1.0).significance for _ in range(200)
    )
    assert 10.0 < largest < 60.0


def test_a_ramp_is_no_scatter(rng):
    one = found(0.1 * TIMES + 0.1 * rng.standard_normal(20))
    assert one.inflation < 4 * 0.1**2
    assert one.size == pytest.approx(1.0, abs=0.2)


def test_scatter_is_measured_in_units_of_the_information(rng):
    values = [found(3.0 * rng.standard_normal((20, 3))).inflation for _ in range(100)]
    assert np.median(values) == pytest.approx(9.0, rel=0.2)
    assert found(np.zeros(20), least=1.0).inflation == 1.0


def test_two_steps_are_no_scatter(rng):
    x = 0.1 * rng.standard_normal(20)
    x[8:12] += 5.0
    assert found(x).inflation < 0.05


def test_only_what_lasts_to_one_end_if_asked_for(rng):
    x = 0.1 * rng.standard_normal(20)
    x[8:12] += 5.0
    one = found(x, one_border=True)
    assert one.begin == 0 or one.end == 20
    assert one.size < 4.0


def test_what_is_known_badly_counts_less(rng):
    x = np.zeros((20, 2))
    x[:10, 0], x[10:, 1] = 1.0, 1.0
    known = np.zeros((20, 2, 2)) + np.diag([100.0, 1.0])
    one = largest_contrast(TIMES, x, known, least_inflation=1.0)
    assert (one.begin, one.end) in ((0, 10), (10, 20))
    # Two means of ten samples each: the variance of their difference is a fifth of that of one.
    assert one.evidence == pytest.approx(5.0 * (100.0 + 1.0), rel=1e-6)
