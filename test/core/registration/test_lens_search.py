"""Lenses by pairs of cameras that see exact points."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.registration.fov_lens import EQUIDISTANT
from stcalib_ros.core.registration.lens_search import FoundLenses, LensUnknowns, search_lenses
from stcalib_ros.core.registration.two_view_lenses import PairPoints

N_POINTS = 150
FOCAL_PX = 1000.0


def ring(n: int, *, radius: float = 4.0, aside: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """R_cam_world and centres of cameras that look at the middle or some metres beside it."""
    rng = np.random.default_rng(1)
    angle = 2 * np.pi * np.arange(n) / n + rng.uniform(-0.2, 0.2, n)
    centres = np.stack([radius * np.cos(angle), radius * np.sin(angle), rng.uniform(0, 2, n)], -1)
    rotations = []
    for centre in centres:
        ahead = aside * rng.uniform(-1, 1, 3) - centre
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotations.append(np.stack([right, np.cross(ahead, right), ahead]))
    return np.stack(rotations), centres


def seen(R: np.ndarray, centres: np.ndarray, lenses: np.ndarray) -> PairPoints:
    """What all pairs of cameras with lenses (C, 2) see of points about the middle."""
    world = np.random.default_rng(2).uniform(-1.2, 1.2, (N_POINTS, 3))
    images = []
    for R_cam, centre, (log_focal, radial) in zip(R, centres, lenses, strict=True):
        rays = (world - centre) @ R_cam.T
        x = rays[:, :2] / rays[:, 2:]
        length, bend = np.linalg.norm(x, axis=-1, keepdims=True), np.sqrt(max(-3 * radial, 1e-12))
        images.append(np.exp(log_focal) * x / length * np.arctan(bend * length) / bend)
    a, b = np.triu_indices(len(R), 1)
    m_a, m_b = (np.stack([images[c] for c in cameras]) for cameras in (a, b))
    full = np.full(len(a), FOCAL_PX)
    observed = np.ones(m_a.shape[:2], dtype=bool)
    return PairPoints(a, b, m_a, m_b, 0 * m_b, observed, full, full, np.full(len(a), 1e3))


def unknowns(column: list[list[int]], **given: list[float]) -> LensUnknowns:
    column = np.array(column)
    n = column.max() + 1
    usual = {"start": [0.0] * n, "mean": [0.0] * n, "stddev": [0.5] * n}
    prior = {name: np.array(value) for name, value in (usual | given).items()}
    return LensUnknowns(column, np.zeros((len(column), 2)), **prior)


def assert_poses(found: FoundLenses, points: PairPoints, R: np.ndarray) -> None:
    true = R[points.a] @ np.swapaxes(R[points.b], -1, -2)
    off = rotation_angle(np.swapaxes(true, -1, -2) @ found.views.R_a_b)
    assert off.max() < 1e-3


def test_four_focal_lengths_of_exact_points_are_exact():
    R, centres = ring(4, aside=0.3)
    lenses = np.array([[-0.6, 0.0], [-0.2, 0.0], [0.1, 0.0], [0.5, 0.0]])
    points = seen(R, centres, lenses)
    found = search_lenses(points, unknowns([[0, -1], [1, -1], [2, -1], [3, -1]], start=[-0.5] * 4))
    assert_allclose(found.views.lenses, lenses, atol=1e-3)
    assert_poses(found, points, R)


@pytest.mark.parametrize("radial", [0.0, -0.1, EQUIDISTANT])
def test_radial_distortion_is_found_with_the_focal_lengths(radial):
    R, centres = ring(4, radius=2.5, aside=0.3)
    lenses = np.array([[-0.8, radial], [-0.7, radial], [-0.6, radial], [-0.5, radial]])
    column = np.arange(8).reshape(4, 2).tolist()
    start = [-0.5, 0.0] * 4
    found = search_lenses(seen(R, centres, lenses), unknowns(column, start=start))
    assert_allclose(found.views.lenses, lenses, atol=5e-3)


def test_cameras_of_one_group_have_one_lens_and_know_it_better():
    R, centres = ring(3, aside=0.3)
    points = seen(R, centres, np.array([[0.2, 0.0]] * 3))
    single = search_lenses(points, unknowns([[0, -1], [1, -1], [2, -1]]))
    shared = search_lenses(points, unknowns([[0, -1], [0, -1], [0, -1]]))
    assert_allclose(shared.views.lenses[:, 0], 0.2, atol=1e-3)
    assert np.ptp(shared.views.lenses[:, 0]) == 0.0
    assert (shared.stddev[:, 0] < 0.95 * single.stddev[:, 0]).all()


def test_what_is_known_stays():
    R, centres = ring(3, aside=0.3)
    points = seen(R, centres, np.array([[0.0, 0.0], [0.3, 0.0], [0.0, 0.0]]))
    found = search_lenses(points, unknowns([[-1, -1], [0, -1], [-1, -1]]))
    assert_allclose(found.views.lenses[:, 0], [0.0, 0.3, 0.0], atol=1e-3)
    assert_allclose(found.stddev[[0, 2]], 0.0)
    assert found.stddev[1, 0] > 0.0


def test_two_cameras_that_look_at_one_point_say_that_they_do_not_know():
    """Three know it, by their rotations."""
    column = [[0, -1], [1, -1], [2, -1]]
    R, centres = ring(3)
    lenses = np.full((3, 2), [0.3, 0.0])
    two = search_lenses(seen(R[:2], centres[:2], lenses[:2]), unknowns(column[:2]))
    assert (two.stddev[:, 0] > 0.2).all()
    three = search_lenses(seen(R, centres, lenses), unknowns(column))
    assert (three.stddev[:, 0] < 0.6 * two.stddev[:, 0].min()).all()
    assert_allclose(three.views.lenses[:, 0], 0.3, atol=0.05)


def test_a_prior_counts_where_the_points_say_nothing():
    R, centres = ring(2)
    points = seen(R, centres, np.array([[0.3, 0.0]] * 2))
    column = [[0, -1], [1, -1]]
    for mean in (-0.2, 0.3):
        found = search_lenses(points, unknowns(column, mean=[mean] * 2, stddev=[0.01] * 2))
        assert_allclose(found.views.lenses[:, 0], mean, atol=0.05)
