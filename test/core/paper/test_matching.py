"""Bipartite matching, and the translation from the epipolar constraint."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stcalib_ros.core.paper.matching import match, mean_angles
from stcalib_ros.core.paper.translation import translation_direction

seeds = st.integers(0, 2**32 - 1)


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


@given(seeds)
def test_angles_are_means_over_what_both_saw(seed):
    rng = np.random.default_rng(seed)
    here, there = unit(rng.normal(size=(2, 1, 3, 4, 3))), unit(rng.normal(size=(2, 1, 1, 3, 4, 3)))
    known_here = rng.integers(0, 2, (2, 1, 3, 4)).astype(float)
    known_there = rng.integers(0, 2, (2, 1, 1, 3, 4)).astype(float)
    R = Rotation.random(rng=rng).as_matrix()
    found = mean_angles(here, known_here, there, known_there, R[None])
    for p in range(2):
        for q in range(2):
            both = (known_here[p, 0] * known_there[q, 0, 0]) > 0
            angles = np.arccos((here[p, 0] * (there[q, 0, 0] @ R.T)).sum(-1))[both]
            expected = angles.mean() if both.any() else np.inf
            assert found[0, 0, p, q] == pytest.approx(expected)


@given(seeds, st.integers(1, 4), st.integers(1, 4))
def test_the_matching_is_the_cheapest_with_nobody_matched_too_far(seed, P, Q):
    angles = np.random.default_rng(seed).uniform(0, 1, (1, P, Q))
    A = match(angles, 0.4)
    assert (A.sum(1) <= 1).all()
    assert (A.sum(2) <= 1).all()
    assert (angles[A] < 0.4).all()
    padded = np.full((P, Q + P), 0.4)
    padded[:, :Q] = angles[0]
    best = min(padded[range(P), list(c)].sum() for c in permutations(range(Q + P), P))
    cost = angles[A].sum() + 0.4 * (P - A.sum())
    assert cost == pytest.approx(best)


def test_a_person_without_common_frames_is_not_matched():
    A = match(np.array([[[np.inf, 0.1], [np.inf, 0.2]]]), 0.4)
    assert A.tolist() == [[[False, True], [False, False]]]


@given(seeds)
def test_the_translation_is_exact_without_noise(seed):
    rng = np.random.default_rng(seed)
    R = Rotation.from_rotvec(0.5 * rng.normal(size=3)).as_matrix()
    t = unit(rng.normal(size=3))
    X_b = rng.uniform([-2, -2, 4], [2, 2, 7], (30, 3))
    X_a = X_b @ R.T + t
    ahead = X_a[:, 2] > 0.1
    if ahead.sum() < 8:
        return
    x_a, x_b = (X[ahead] / X[ahead, 2:] for X in (X_a, X_b))
    assert translation_direction(R, x_a, x_b) == pytest.approx(t, abs=1e-6)
