"""Radial distortion against OpenCV, its derivatives and its inverse."""

import numpy as np
import pytest

from stcalib_ros.core.geometry.lens import bearings, change_lens, project
from stcalib_ros.core.geometry.radial import is_radial, radial_profile
from stcalib_ros.core.model.recording import Intrinsics, LensModel

K = np.array([[700.0, 0, 959.5], [0, 710.0, 539.5], [0, 0, 1]])


def lens(model, D):
    return Intrinsics(1920, 1080, model, K, np.array(D, dtype=float))


LENSES = [
    lens(LensModel.PLUMB_BOB, []),
    lens(LensModel.PLUMB_BOB, [-0.2, 0.05, 0, 0, 0.01]),
    lens(LensModel.EQUIDISTANT, [0.05, -0.01, 0.002, 0]),
    lens(LensModel.RATIONAL_POLYNOMIAL, [0.3, 0.1, 0, 0, 0.01, 0.6, 0.2, 0.03]),
]
BENT = lens(LensModel.PLUMB_BOB, [-0.2, 0.05, 0.01, -0.01, 0])


@pytest.fixture
def pixels(rng):
    return rng.uniform([300, 0], [1600, 1080], (500, 2))


@pytest.mark.parametrize("given", [*LENSES, BENT])
def test_undistorted_points_project_onto_their_pixels(given, pixels):
    x, focal = bearings(pixels, given)
    rays = np.concatenate([x, np.ones((len(x), 1))], 1)
    np.testing.assert_allclose(project(rays, given), pixels, atol=1e-6)
    assert is_radial(given) == (given is not BENT)
    side, other = (project(rays + 1e-6 * axis, given) - pixels for axis in np.eye(3)[:2])
    area = np.abs(side[:, 0] * other[:, 1] - side[:, 1] * other[:, 0]) / 1e-12
    np.testing.assert_allclose(focal, np.sqrt(area), rtol=1e-4)


@pytest.mark.parametrize("given", LENSES)
def test_derivatives_are_those_of_the_profile(given):
    profile = radial_profile([given])
    r = np.linspace(0.01, 1.2, 30)[None]
    at, ahead = profile.at(r), profile.at(r + 1e-6)
    grown = (ahead.gain * ahead.r - at.gain * at.r) / 1e-6
    np.testing.assert_allclose(at.slope, grown, rtol=1e-5)
    for n, column in enumerate([0, 1], start=1):
        D = np.pad(given.D, (0, max(0, 5 - given.D.size)))[: max(given.D.size, 5)]
        if given.model is LensModel.EQUIDISTANT:
            D = given.D.copy()
        D[column] += 1e-6
        moved = radial_profile([lens(given.model, D)]).at(r)
        rate = (moved.gain - at.gain) / 1e-6
        np.testing.assert_allclose(at.by_coefficient(n), rate, rtol=1e-4, atol=1e-9)


def test_points_beyond_the_fold_of_a_lens_are_not_known():
    folding = lens(LensModel.PLUMB_BOB, [-0.4, 0, 0, 0, 0])
    x, _ = bearings(np.array([[959.5, 539.5], [1919.0, 1079.0]]), folding)
    assert np.isfinite(x[0]).all()
    assert np.isnan(x[1]).all()


def test_a_change_of_the_lens_is_that_of_the_pixels(pixels):
    before, after = LENSES[0], LENSES[2]
    x, focal = change_lens(bearings(pixels, before)[0], before, after)
    there, its_focal = bearings(pixels, after)
    np.testing.assert_allclose(x, there, atol=1e-9)
    np.testing.assert_allclose(focal, its_focal)
