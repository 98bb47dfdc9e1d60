"""The field-of-view model against the lenses that it contains."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stcalib_ros.core.geometry.lens import bearings, project
from stcalib_ros.core.lifting.assumed_lenses import assumed_lens
from stcalib_ros.core.model.recording import Intrinsics, LensModel, unknown_intrinsics
from stcalib_ros.core.registration.fov_lens import (
    EQUIDISTANT,
    fitted_lens,
    scaled_lens,
    undistorted,
)

START = assumed_lens(unknown_intrinsics(1920, 1080))


def points(n: int = 40, radius: float = 0.6) -> np.ndarray:
    """Points (n, 2) by the lens to start from, within a radius."""
    rng = np.random.default_rng(0)
    angle, r = rng.uniform(0, 2 * np.pi, n), radius * np.sqrt(rng.uniform(0, 1, n))
    return np.stack([r * np.cos(angle), r * np.sin(angle)], -1)


def pixels(m: np.ndarray) -> np.ndarray:
    return m * START.K[0, 0] + START.K[:2, 2]


@pytest.mark.parametrize("ratio", [0.5, 1.0, 1.7])
def test_without_a_radial_coefficient_it_is_a_pinhole(ratio):
    m = points()
    x, focal = undistorted(m, np.array([np.log(ratio), 0.0]))
    assert_allclose(x, m / ratio, atol=1e-12)
    assert_allclose(focal, ratio, rtol=1e-12)


@pytest.mark.parametrize("ratio", [0.6, 1.0])
def test_with_minus_a_third_it_is_an_equidistant_lens(ratio):
    m, lens = points(), np.array([np.log(ratio), EQUIDISTANT])
    fisheye = fitted_lens(START, lens, radius=0.6, radial_terms=1)
    assert fisheye.model is LensModel.EQUIDISTANT
    x, focal = undistorted(m, lens)
    assert_allclose(bearings(pixels(m), fisheye)[0], x, atol=1e-6)
    assert_allclose(bearings(pixels(m), fisheye)[1], START.K[0, 0] * focal, rtol=1e-4)


@pytest.mark.parametrize("radial", [-0.3, -0.1, 1e-9, 0.2])
def test_focal_is_the_root_of_the_determinant_of_its_derivatives(radial):
    m, lens, step = points(), np.array([0.2, radial]), 1e-6
    columns = [
        (undistorted(m + e, lens)[0] - undistorted(m - e, lens)[0]) / (2 * step)
        for e in step * np.eye(2)
    ]
    determinant = np.linalg.det(np.stack(columns, -1))
    assert_allclose(undistorted(m, lens)[1], determinant**-0.5, rtol=1e-6)


@pytest.mark.parametrize(("radial", "terms", "limit_px"), [(-0.15, 1, 2.0), (-0.15, 2, 0.2)])
def test_the_nearest_plumb_bob_is_within_pixels(radial, terms, limit_px):
    m, lens = points(), np.array([-0.1, radial])
    fitted = fitted_lens(START, lens, radius=0.6, radial_terms=terms)
    assert fitted.model is LensModel.PLUMB_BOB
    assert fitted.D[0] == pytest.approx(radial, abs=0.03)
    x = undistorted(m, lens)[0]
    rays = np.concatenate([x, np.ones((len(x), 1))], -1)
    assert np.abs(project(rays, fitted) - pixels(m)).max() < limit_px


def test_a_pinhole_stays_one():
    fitted = fitted_lens(START, np.array([0.3, 0.0]), radius=0.5, radial_terms=1)
    assert_allclose(fitted.K[[0, 1], [0, 1]], 1536.0 * np.exp(0.3))
    assert_allclose(fitted.K[:2, 2], [959.5, 539.5])
    assert_allclose(fitted.D, 0.0, atol=1e-12)


def test_a_lens_that_is_refined_keeps_its_distortion():
    K = np.array([[800.0, 0, 300], [0, 820.0, 250], [0, 0, 1]])
    given = Intrinsics(640, 480, LensModel.RATIONAL_POLYNOMIAL, K, np.arange(8) / 100)
    scaled = scaled_lens(given, np.array([np.log(1.1), 0.0]))
    assert_allclose(scaled.K, [[880.0, 0, 300], [0, 902.0, 250], [0, 0, 1]])
    assert scaled.model is given.model
    assert_allclose(scaled.D, given.D)
