"""Cubic B-splines, against what defines them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stcalib_ros.core.geometry import bsplines as splines

positions = st.lists(st.floats(0.0, 8.99), min_size=1, max_size=20).map(np.array)
K = 12


@given(positions)
def test_the_four_splines_at_a_position_add_up_to_one(position):
    np.testing.assert_allclose(splines.basis(position).sum(0), 1.0, atol=1e-12)
    assert (splines.basis(position) >= -1e-12).all()


@given(positions, st.integers(0, 2**32 - 1))
def test_derivatives_are_those_of_the_values(position, seed):
    c = np.random.default_rng(seed).normal(size=(K, 2, 3))
    h = 1e-5
    position = np.clip(position, h, 9 - 2 * h)
    for n in range(2):
        ahead, behind = (splines.values(position + s * h, c, n) for s in (1, -1))
        slope = splines.values(position, c, n + 1)
        np.testing.assert_allclose((ahead - behind) / (2 * h), slope, atol=1e-4)


def test_equidistant_coefficients_are_a_straight_line():
    c = 2.0 * np.arange(K)[:, None] - 3.0
    position = np.linspace(0, 8.9, 30)
    np.testing.assert_allclose(splines.values(position, c)[:, 0], 2.0 * (position + 1) - 3.0)
    np.testing.assert_allclose(splines.values(position, c, 1), 2.0)
    np.testing.assert_allclose(splines.values(position, c, 2), 0.0, atol=1e-12)


@pytest.fixture
def dense(rng):
    """Positions, and the matrix (T, K) that makes values of coefficients."""
    position = rng.uniform(0, 8.99, 25)
    B = splines.values(position, np.eye(K))
    return position, B


def test_sums_are_the_transposed_of_values(rng, dense):
    position, B = dense
    y = rng.normal(size=(25, 2, 3))
    found = splines.summed(position, K, splines.basis(position), y)
    np.testing.assert_allclose(found, np.einsum("tk,tij->kij", B, y), atol=1e-12)


def test_bands_are_those_of_the_normal_equations(rng, dense):
    position, B = dense
    A = rng.normal(size=(25, 2, 3, 3))
    squares = A @ A.swapaxes(-1, -2)
    full = np.einsum("tk,tl,tmij->mkilj", B, B, squares, optimize=True).reshape(2, 3 * K, 3 * K)
    band = splines.banded(splines.summed_squares(position, K, squares))
    for m in range(2):
        for d in range(band.shape[1]):
            found, true = band[m, d, : 3 * K - d], np.diagonal(full[m], -d)
            np.testing.assert_allclose(found, true, atol=1e-12)
        assert not np.tril(full[m], -band.shape[1]).any()


def test_second_differences():
    D = np.diff(np.eye(K), 2, axis=0)
    found = splines.second_differences(K)
    for d in range(splines.SUPPORT):
        np.testing.assert_allclose(found[d, : K - d], np.diagonal(D.T @ D, -d))
