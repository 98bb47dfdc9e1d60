"""Correlations against sums written out; their matrices against residuals and noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from epipolar_helpers import (
    FOCAL_PX,
    STEP_S,
    camera_of,
    matrix_error,
    projected,
    random_pose,
    random_views,
    track_of,
)
from hypothesis import given
from hypothesis import strategies as st

from stcalib_ros.core.geometry.epipolar import sampson
from stcalib_ros.core.geometry.so3 import hat
from stcalib_ros.core.registration.epipolar_correlation import (
    ONE,
    best_essential,
    correlate,
    keypoint_moments,
    mean_square,
    moments_at,
    noise_of_moments,
    pencil,
    screening_distance,
)
from stcalib_ros.core.registration.resampling import Grid, common_grid

seeds = st.integers(0, 2**32 - 1)
JOINTS = 3
FACTORS = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
"""Coordinates of which the six monomials are products."""


def random_camera(rng, spans, *, missing=0.2):
    """Tracks of random keypoints that begin at a frame and are so long."""
    tracks = []
    for first, length in spans:
        x = rng.normal(size=(length, JOINTS, 2))
        x[rng.uniform(size=x.shape[:2]) < missing] = np.nan
        tracks.append(track_of(x, first))
    return camera_of(tracks)


def on_grid(camera, n=60):
    return keypoint_moments(camera, Grid(0.0, STEP_S, n))


def direct_sums(a, b, lag):
    """Sums (6, 6) of two `KeypointMoments` of one track each, sample by sample."""
    (here,), (there,) = a.values, b.values
    total = np.zeros((6, 6))
    for k in range(here.shape[1]):
        other = a.first[0] + k + lag - b.first[0]
        if 0 <= other < there.shape[1]:
            total += here[:, k] @ there[:, other].T
    return total


def one_track(camera, p):
    return on_grid(replace(camera, tracks=camera.tracks[p : p + 1]))


def sums_of(x_a, x_b, lag=0):
    """Sums (6, 6) over the keypoints (F, J, 2) of one track each."""
    a, b = (on_grid(camera_of([track_of(x)]), len(x)) for x in (x_a, x_b))
    return moments_at(a, b, 0, 0, lag)


def seen(x, joints=JOINTS):
    """Homogeneous points (M, 3) as keypoints (F, J, 2)."""
    return x[:, :2].reshape(-1, joints, 2)


# Monomials


def test_monomials_are_products_of_the_coordinates_of_what_is_observed(rng):
    camera = random_camera(rng, [(4, 9)])
    moments = on_grid(camera)
    (values,) = moments.values
    x = camera.tracks[0].x
    h = np.concatenate([x, np.ones((9, JOINTS, 1))], -1)
    # Interpolation needs an image to both sides.
    known = values[ONE] > 0
    assert 0 < known.sum() < 27
    for value, (i, j) in zip(values, FACTORS, strict=True):
        np.testing.assert_allclose(value[known], (h[..., i] * h[..., j])[known], atol=1e-12)
        assert not value[~known].any()
    assert moments.first.tolist() == [4]
    assert moments.end.tolist() == [13]
    assert moments.focal_px == FOCAL_PX


@given(seeds, st.integers(1, 4))
def test_thinned_is_a_coarser_grid(seed, every):
    rng = np.random.default_rng(seed)
    camera = random_camera(rng, [(int(first), 13) for first in rng.integers(0, 40, 3)])
    thinned = on_grid(camera, 61).thinned(every)
    coarse = keypoint_moments(camera, Grid(0.0, every * STEP_S, 60 // every + 1))
    np.testing.assert_array_equal(thinned.first, coarse.first)
    for one, other in zip(thinned.values, coarse.values, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-6)


def test_a_track_outside_of_the_grid_has_no_samples(rng):
    camera = random_camera(rng, [(0, 10), (30, 10)])
    moments = on_grid(camera, 20)
    assert [v.shape[1] for v in moments.values] == [10, 0]


# Correlation


@given(seeds)
def test_correlations_at_all_lags_are_the_sums_written_out(seed):
    rng = np.random.default_rng(seed)
    spans = [[(int(rng.integers(0, 15)), int(rng.integers(2, 20))) for _ in "pq"] for _ in "ab"]
    cameras = [random_camera(rng, one) for one in spans]
    a, b = (on_grid(camera) for camera in cameras)
    max_lag = int(rng.integers(0, 40))
    for p, c in correlate(a, b, max_lag=max_lag):
        for q in range(2):
            alone = one_track(cameras[0], p), one_track(cameras[1], q)
            for k, lag in enumerate(range(-max_lag, max_lag + 1)):
                direct = direct_sums(*alone, lag)
                np.testing.assert_allclose(c[q, k], direct, atol=1e-9)
                np.testing.assert_allclose(moments_at(a, b, p, q, lag), direct, atol=1e-9)


def test_tracks_that_do_not_meet_have_exactly_nothing_in_common(rng):
    a, b = on_grid(random_camera(rng, [(0, 5)])), on_grid(random_camera(rng, [(40, 5)]))
    ((_, c),) = correlate(a, b, max_lag=35)
    assert not c.any()
    assert not moments_at(a, b, 0, 0, 35).any()
    assert moments_at(a, b, 0, 0, 36)[ONE, ONE] >= 0


# The matrices


@given(seeds)
def test_the_form_of_any_matrix_is_the_sum_of_its_squared_residuals(seed):
    rng = np.random.default_rng(seed)
    x_a, x_b, _ = random_views(rng)
    M, N = pencil(sums_of(seen(x_a), seen(x_b)))
    E = rng.normal(size=(3, 3))
    e = E.ravel()
    residuals = np.einsum("mi,ij,mj->m", x_a, E, x_b)
    slopes = ((E @ x_b.T)[:2] ** 2).sum() + ((E.T @ x_a.T)[:2] ** 2).sum()
    # The first sample has no image before it, but lies on one.
    np.testing.assert_allclose(e @ M @ e, (residuals**2).sum(), rtol=1e-6)
    np.testing.assert_allclose(e @ N @ e, slopes, rtol=1e-6)
    np.testing.assert_allclose(mean_square(E, M, N), (residuals**2).sum() / slopes, rtol=1e-6)
    here, there = x_a.T @ x_a, x_b.T @ x_b
    np.testing.assert_allclose(noise_of_moments(here, there), N, atol=1e-6)


def test_noise_adds_to_the_form_what_is_predicted(rng):
    x_a, x_b, _ = random_views(rng, 6)
    _, N = pencil(sums_of(seen(x_a), seen(x_b)))
    sigma = 0.1
    noise = np.zeros((2, 20_000, 6, 3))
    noise[..., :2] = sigma * rng.normal(size=(2, 20_000, 6, 2))

    def form(a, b):
        products = (a[..., :, None] * b[..., None, :]).reshape(-1, 9)
        return products.T @ products

    # The same noise with either sign: what is of odd order cancels.
    with_noise = (
        form(x_a + noise[0], x_b + noise[1])
        + form(x_a - noise[0], x_b - noise[1])
        + form(x_a - noise[0], x_b + noise[1])
        + form(x_a + noise[0], x_b - noise[1])
    ) / 4
    added = with_noise / len(noise[0]) - form(x_a, x_b)
    fourth = np.kron(np.diag([1, 1, 0]), np.diag([1, 1, 0])) * 6 * sigma**4
    np.testing.assert_allclose((added - fourth) / sigma**2, N, atol=0.02 * N.max())


# The best matrix


@given(seeds)
def test_of_exact_points_the_essential_matrix_is_found(seed):
    x_a, x_b, E = random_views(np.random.default_rng(seed), 60)
    squares, found = best_essential(*pencil(sums_of(seen(x_a), seen(x_b))))
    assert matrix_error(found, E) < 1e-4
    assert squares[0] < 1e-9
    assert squares[1] > 100 * squares[0]


@given(seeds, st.sampled_from([1e-3, 3e-3]))
def test_the_least_distance_is_the_variance_of_the_noise(seed, sigma):
    rng = np.random.default_rng(seed)
    n = 3000
    x_a, x_b, E = random_views(rng, n)
    for x in (x_a, x_b):
        x[:, :2] += sigma * rng.normal(size=(n, 2))
    M, N = pencil(sums_of(seen(x_a), seen(x_b)))
    squares, found = best_essential(M, N)
    # Five standard deviations of a mean of n squares.
    assert squares[0] == pytest.approx(sigma**2, rel=5 * np.sqrt(2 / n))
    assert mean_square(found, M, N) == pytest.approx(squares[0], rel=1e-3)
    assert squares[0] <= mean_square(E, M, N) * (1 + 1e-6)
    r = sampson(found, x_a, x_b)
    assert (r**2).mean() == pytest.approx(squares[0], rel=0.1)


def along(found, truth):
    """A matrix of length one, of the sign that is nearer to the truth."""
    return found / np.linalg.norm(found) * np.sign((found * truth).sum())


def test_it_has_not_the_bias_of_the_smallest_eigenvector_of_the_form():
    """The mean over many draws of the noise is the truth; that of the eight-point method is not."""
    rng = np.random.default_rng(5)
    x_a, x_b, E = random_views(rng, 300)
    E = E / np.linalg.norm(E)
    ours, eight_point = np.zeros((3, 3)), np.zeros((3, 3))
    for _ in range(200):
        noisy = [x + 0.02 * rng.normal(size=x.shape) * [1, 1, 0] for x in (x_a, x_b)]
        M, N = pencil(sums_of(*(seen(x) for x in noisy)))
        ours += along(best_essential(M, N)[1], E)
        eight_point += along(np.linalg.eigh(M)[1][:, 0].reshape(3, 3), E)
    assert matrix_error(ours, E) < 0.3 * matrix_error(eight_point, E)


@given(seeds)
def test_screening_is_a_lower_bound_within_fifteen_percent(seed):
    rng = np.random.default_rng(seed)
    x_a, x_b, _ = random_views(rng, 60)
    sigma = 10.0 ** rng.uniform(-3, -1)
    x_a[:, :2] += sigma * rng.normal(size=(60, 2))
    M, N = pencil(sums_of(seen(x_a), seen(x_b)))
    least = best_essential(M, N)[0][0]
    screened = screening_distance(M, N)
    # Its ridge is the larger one.
    assert 0.85 * least < screened < least * (1 + 1e-2)


def test_forms_of_several_tracks_add_up_and_stacks_are_looked_at_one_by_one(rng):
    views = [random_views(rng, 30) for _ in range(4)]
    c = np.stack([sums_of(seen(x_a), seen(x_b)) for x_a, x_b, _ in views]).reshape(2, 2, 6, 6)
    together = [np.concatenate([v[k] for v in views]) for k in (0, 1)]
    np.testing.assert_allclose(c.sum((0, 1)), sums_of(*(seen(x) for x in together)), rtol=1e-9)
    M, N = pencil(c)
    squares, E = best_essential(M, N)
    screened = screening_distance(M, N)
    for i, j in np.ndindex(2, 2):
        one, matrix = best_essential(M[i, j], N[i, j])
        np.testing.assert_allclose(squares[i, j], one, rtol=1e-6)
        assert matrix_error(E[i, j], matrix) < 1e-6
        assert screened[i, j] == pytest.approx(screening_distance(M[i, j], N[i, j]))


# Motion that does not determine the matrix


def plane(rng, n):
    return rng.uniform([-1, -1, 4], [1, 1, 4], (n, 3))


def line(rng, n):
    return rng.uniform(-1, 1, (n, 1)) * [1.0, 0.5, 0.2] + [0.0, 0.0, 4.0]


def room(rng, n):
    return rng.uniform([-1, -1, 3], [1, 1, 6], (n, 3))


@pytest.mark.parametrize(("points", "degenerate"), [(plane, True), (line, True), (room, False)])
def test_where_motion_is_degenerate_two_matrices_have_a_small_distance(rng, points, degenerate):
    R_a_b, t_a_b = random_pose(rng)
    X = points(rng, 300)
    x_a, x_b = projected(X), projected((X - t_a_b) @ R_a_b)
    sigma = 1e-3
    for x in (x_a, x_b):
        x[:, :2] += sigma * rng.normal(size=(300, 2))
    squares, E = best_essential(*pencil(sums_of(seen(x_a), seen(x_b))))
    assert np.sqrt(squares[0]) < 1.2 * sigma
    assert (np.sqrt(squares[1]) < 2 * sigma) == degenerate
    assert (matrix_error(E, hat(t_a_b) @ R_a_b) < 0.1) != degenerate


def test_the_grid_of_a_camera_takes_its_own_images(rng):
    camera = random_camera(rng, [(0, 20)], missing=0)
    moments = keypoint_moments(camera, common_grid([camera]))
    np.testing.assert_allclose(moments.values[0][2], camera.tracks[0].x[..., 0], atol=1e-9)
