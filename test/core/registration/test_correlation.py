"""Cross-covariances at all lags, against the sum that they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stcalib_ros.core.geometry.alignment import best_rotation
from stcalib_ros.core.registration import correlation
from stcalib_ros.core.registration.correlation import cross_covariance
from stcalib_ros.core.registration.resampling import GridTracks

seeds = st.integers(0, 2**32 - 1)


def random_tracks(rng, P, n=30, D=5, *, share=0.8):
    """Tracks with holes: random unit vectors times random weights."""
    present = rng.uniform(size=(P, n)) < share
    weight = rng.uniform(0.3, 1, (P, n, D)) * present[..., None]
    unit = rng.normal(size=(P, n, D, 3))
    unit /= np.linalg.norm(unit, axis=-1, keepdims=True)
    position = np.where(present[..., None], rng.normal(size=(P, n, 3)), np.nan)
    return GridTracks("cam", 0.0, 1.0, unit * weight[..., None], position)


def brute_force(a, b, lag):
    """S (P, Q, 3, 3), mass and overlap (P, Q) of one lag, moment by moment."""
    P, Q, n = len(a.oriented), len(b.oriented), a.oriented.shape[1]
    S, mass, overlap = np.zeros((P, Q, 3, 3)), np.zeros((P, Q)), np.zeros((P, Q))
    for k in range(n):
        if not 0 <= k + lag < n:
            continue
        for p in range(P):
            for q in range(Q):
                S[p, q] += a.oriented[p, k].T @ b.oriented[q, k + lag]
                mass[p, q] += a.weight[p, k] @ b.weight[q, k + lag]
                overlap[p, q] += a.present[p, k] and b.present[q, k + lag]
    return S, mass, overlap


@given(seeds, st.integers(1, 3), st.integers(1, 3), st.sampled_from([1, 200, 10_000]))
def test_the_transform_gives_the_sum_at_every_lag(seed, P, Q, most_values):
    rng = np.random.default_rng(seed)
    a, b = random_tracks(rng, P, n=14), random_tracks(rng, Q, n=14)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(correlation, "_BLOCK_VALUES", most_values)
        covariance = cross_covariance(a, b, max_lag=13)
    np.testing.assert_array_equal(covariance.lags, np.arange(-13, 14))
    for i, lag in enumerate(covariance.lags):
        S, mass, overlap = brute_force(a, b, int(lag))
        np.testing.assert_allclose(covariance.S[:, :, i], S, atol=2e-5)
        np.testing.assert_allclose(covariance.mass[:, :, i], mass, atol=2e-5)
        np.testing.assert_array_equal(covariance.overlap[:, :, i], overlap)


@pytest.mark.parametrize(("max_lag", "lags"), [(3, 7), (29, 59), (500, 59)])
def test_lags_are_those_asked_for_while_there_is_any_overlap(rng, max_lag, lags):
    covariance = cross_covariance(random_tracks(rng, 1), random_tracks(rng, 1), max_lag=max_lag)
    assert len(covariance.lags) == lags
    assert covariance.S.shape == (1, 1, lags, 3, 3)


def moved(tracks, R_a_b, lag):
    """The same tracks seen from camera b, `lag` samples later."""
    turned = tracks.oriented @ R_a_b
    return GridTracks(
        "b",
        0.0,
        1.0,
        np.roll(turned, lag, axis=1),
        np.roll(tracks.position, lag, axis=1),
    )


@pytest.mark.parametrize("lag", [-6, 0, 9])
def test_a_turned_and_delayed_copy_scores_one_at_its_lag(rng, lag):
    a = random_tracks(rng, 2, n=60, share=1.0)
    R_a_b = Rotation.random(rng=rng).as_matrix()
    b = moved(a, R_a_b, lag)
    covariance = cross_covariance(a, b, max_lag=12)
    score = covariance.score(min_overlap=12)
    at = int(np.flatnonzero(covariance.lags == lag)[0])
    for p in range(2):
        # What np.roll wraps around at the ends is noise: at most 9 of 60 samples.
        assert np.nanargmax(score[p, p]) == at
        np.testing.assert_allclose(score[p, p, at], 1, atol=1e-4)
        np.testing.assert_allclose(best_rotation(covariance.S[p, p, at]), R_a_b, atol=1e-4)
    assert np.nanmax(score[0, 1]) < 0.6


def test_a_score_is_at_most_one(rng):
    covariance = cross_covariance(random_tracks(rng, 3), random_tracks(rng, 2), max_lag=20)
    score = covariance.score(min_overlap=1)
    assert np.nanmax(score) <= 1 + 1e-4
    assert np.nanmin(score) > 0


def test_too_little_overlap_has_no_score(rng):
    covariance = cross_covariance(random_tracks(rng, 2), random_tracks(rng, 2), max_lag=29)
    score = covariance.score(min_overlap=12)
    np.testing.assert_array_equal(np.isnan(score), covariance.overlap < 12)
    assert np.isnan(score).any()
    assert np.isfinite(score).any()
