"""Assignments are those of SciPy, which of several equal ones included."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from stcalib_ros.core.geometry.assignment import assign


@pytest.mark.parametrize("shape", [(0, 3), (3, 0), (1, 1), (4, 4), (3, 7), (7, 3), (12, 15)])
@pytest.mark.parametrize("highest", [1, 2, 5, 1000])
@pytest.mark.parametrize("maximize", [False, True])
def test_assignments_are_those_of_scipy(rng, shape, highest, maximize):
    for _ in range(10):
        cost = rng.integers(0, highest, shape).astype(float)  # few numbers: many are equal
        rows, columns = assign(cost, maximize=maximize)
        expected = linear_sum_assignment(cost, maximize=maximize)
        np.testing.assert_array_equal([rows, columns], expected)


def test_numbers_that_are_no_integers(rng):
    for _ in range(50):
        cost = rng.normal(size=rng.integers(1, 12, 2))
        np.testing.assert_array_equal(assign(cost), linear_sum_assignment(cost))


def test_what_is_infinite_is_not_assigned(rng):
    cost = rng.uniform(size=(6, 6))
    cost[rng.uniform(size=cost.shape) < 0.4] = np.inf
    np.fill_diagonal(cost, 10.0)
    np.testing.assert_array_equal(assign(cost), linear_sum_assignment(cost))


@pytest.mark.parametrize("wrong", [np.nan, -np.inf])
def test_what_is_no_cost(wrong):
    with pytest.raises(ValueError, match="NaN"):
        assign(np.array([[1.0, wrong], [2.0, 3.0]]))


def test_no_assignment_of_finite_cost():
    with pytest.raises(ValueError, match="finite"):
        assign(np.array([[1.0, np.inf], [2.0, np.inf]]))
