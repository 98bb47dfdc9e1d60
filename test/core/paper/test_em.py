"""Responsibilities, mixing proportions and rotation of the mixture."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stcalib_ros.core.geometry.alignment import best_rotation
from stcalib_ros.core.geometry.so3 import exp_so3, rotation_angle
from stcalib_ros.core.paper.em import (
    gather_evidence,
    maximise,
    mixing_proportions,
    responsibilities,
)
from stcalib_ros.core.paper.vmf import fit, log_normaliser

T, S = 4, 7
seeds = st.integers(0, 2**32 - 1)


def people(rng, n, noise=0.05):
    """Directions (n, T, S, 3) of people in poses of their own."""
    v = rng.normal(size=(n, 1, S, 3)) + noise * rng.normal(size=(n, T, S, 3))
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def evidence_of(target, source):
    """Of one window and one offset."""
    resultant = source.sum(1)[:, None, None]
    model = fit(resultant, np.full(resultant.shape[:-1], float(T)))
    seen = np.ones((len(source), 1, 1), dtype=bool)
    known = np.ones((len(target), 1, T, S))
    return gather_evidence(target[:, None], known, model, seen), model


def scene(seed, n=3):
    """Target and source views of the same people in another order, and the rotation."""
    rng = np.random.default_rng(seed)
    R = Rotation.random(rng=rng).as_matrix()
    target, order = people(rng, n), rng.permutation(n)
    source = (target @ R)[order]
    return rng, target, source, R, order


def explicit_log_likelihood(v, model, q, R):
    """``log prod_tau,s f(v; R mu, kappa)`` of one target person, frame by frame."""
    return sum(
        float(
            log_normaliser(model.kappa[q, 0, 0, s])
            + model.kappa[q, 0, 0, s] * (R @ model.mu[q, 0, 0, s]) @ v[tau, s]
        )
        for tau, s in product(range(T), range(S))
    )


@given(seeds)
def test_responsibilities_are_those_of_the_equation(seed):
    rng, target, source, _, _ = scene(seed)
    evidence, model = evidence_of(target, 0.3 * source + 0.7 * people(rng, 3, 0.5))
    R = Rotation.random(rng=rng).as_matrix()
    pi = rng.dirichlet(np.ones(3))
    gamma, total = responsibilities(evidence, R[None, None], pi[None, None, None, None])
    value = np.array(
        [
            [explicit_log_likelihood(v, model, q, R) + T * np.log(pi[q]) for q in range(3)]
            for v in target
        ]
    )
    weight = np.exp(value - value.max(1, keepdims=True))
    assert gamma[0, 0, 0] == pytest.approx(weight / weight.sum(1, keepdims=True), abs=1e-9)
    assert total[0, 0] == pytest.approx(np.logaddexp.reduce(value, axis=1).sum(), rel=1e-9)


@given(seeds)
def test_the_gradient_of_the_paper_vanishes_at_the_rotation_taken(seed):
    rng = np.random.default_rng(seed)
    gamma, kappa = rng.uniform(size=(3, 4)), rng.uniform(1, 500, 4)
    v, mu = people(rng, 3)[:, :, 0], people(rng, 4)[:, 0, 0]
    M = np.einsum("pq,q,pti,qj->ij", gamma, kappa, v, mu)
    R = best_rotation(M)

    def gradient(R):
        return sum(
            gamma[p, q] * kappa[q] * np.cross(R @ mu[q], v[p, tau])
            for p, q, tau in product(range(3), range(4), range(T))
        )

    def value(R):
        return float((R * M).sum())

    scale = np.abs(M).sum()
    assert gradient(R) == pytest.approx(np.zeros(3), abs=1e-9 * scale)
    away = exp_so3(0.01 * rng.normal(size=3)) @ R
    assert value(away) < value(R)
    omega = 1e-6 * rng.normal(size=3)
    rise = value(exp_so3(omega) @ away) - value(exp_so3(-omega) @ away)
    assert rise == pytest.approx(2 * omega @ gradient(away), abs=1e-9 * scale)


@given(seeds)
def test_mixing_proportions_are_shares_that_maximise_the_expected_likelihood(seed):
    rng = np.random.default_rng(seed)
    gamma = rng.dirichlet(np.ones(4), size=(1, 1, 1, 5))
    pi = mixing_proportions(gamma)[0, 0, 0, 0]
    assert pi.sum() == pytest.approx(1.0)
    value = (gamma * np.log(pi)).sum()
    for _ in range(5):
        other = 0.9 * pi + 0.1 * rng.dirichlet(np.ones(4))
        assert (gamma * np.log(other)).sum() <= value + 1e-12


@given(seeds)
def test_no_step_lowers_the_likelihood(seed):
    rng, target, source, _, _ = scene(seed)
    evidence, _ = evidence_of(target, source + 0.3 * people(rng, 3))
    R = Rotation.random(rng=rng).as_matrix()[None, None]
    pi = np.full((1, 1, 1, 1, 3), 1 / 3)
    gamma, before = responsibilities(evidence, R, pi)
    for _ in range(8):
        pi = mixing_proportions(gamma)
        R = best_rotation((gamma.reshape(1, 1, -1) @ evidence.B.reshape(1, -1, 9)).reshape(R.shape))
        gamma, after = responsibilities(evidence, R, pi)
        assert after[0, 0] >= before[0, 0] - 1e-6 * abs(before[0, 0])
        before = after


@given(seeds)
def test_people_seen_without_noise_give_rotation_and_association(seed):
    rng, target, source, R_true, order = scene(seed)
    evidence, _ = evidence_of(target, source)
    start = exp_so3(0.2 * rng.normal(size=(1, 3, 3))) @ R_true
    found = maximise(evidence, start)
    best = found.log_likelihood[0].argmax()
    assert rotation_angle(found.R[0, best].T @ R_true) < 0.02
    assert found.gamma[0, best, 0].argmax(0).tolist() == order.tolist()


def test_a_person_who_is_not_there_has_no_part():
    _, target, source, _, _ = scene(5)
    resultant = source.sum(1)[:, None, None]
    model = fit(resultant, np.full(resultant.shape[:-1], float(T)))
    seen = np.array([True, False, True])[:, None, None]
    evidence = gather_evidence(target[:, None], np.ones((3, 1, T, S)), model, seen)
    gamma, _ = responsibilities(evidence, np.eye(3)[None, None], np.full((1, 1, 1, 1, 3), 1 / 3))
    assert not gamma[..., 1].any()
    assert gamma.sum(-1) == pytest.approx(np.ones((1, 1, 1, 3)))


def test_a_window_without_anybody_says_nothing():
    _, target, source, _, _ = scene(6)
    resultant = source.sum(1)[:, None, None]
    model = fit(resultant, np.full(resultant.shape[:-1], float(T)))
    nobody = np.zeros((3, 1, 1), dtype=bool)
    evidence = gather_evidence(target[:, None], np.ones((3, 1, T, S)), model, nobody)
    found = maximise(evidence, np.eye(3)[None, None])
    assert not found.gamma.any()
    assert found.log_likelihood.tolist() == [[0.0]]
    assert np.isfinite(found.R).all()
