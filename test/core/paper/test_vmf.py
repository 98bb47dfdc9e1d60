"""Von Mises-Fisher distributions against SciPy and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import vonmises_fisher

from stcalib_ros.core.paper.vmf import fit, log_normaliser, mean_resultant_length

kappas = st.floats(1e-2, 9e3)
seeds = st.integers(0, 2**32 - 1)


def direction(rng):
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


@given(kappas, seeds, st.integers(2, 500))
def test_the_mean_of_a_distribution_gives_its_parameters_back(kappa, seed, n):
    mu = direction(np.random.default_rng(seed))
    found = fit(n * mean_resultant_length(np.array(kappa)) * mu, np.array(float(n)))
    assert found.mu == pytest.approx(mu, abs=1e-12)
    assert found.kappa == pytest.approx(kappa, rel=1e-6)


@pytest.mark.parametrize("kappa", [2.0, 50.0, 400.0])
def test_samples_give_the_estimate_that_scipy_finds(kappa):
    mu = np.array([0.6, 0.0, 0.8])
    v = vonmises_fisher(mu, kappa).rvs(3000, random_state=np.random.default_rng(1))
    found = fit(v.sum(0), np.array(3000.0))
    scipy_mu, scipy_kappa = vonmises_fisher.fit(v)
    assert found.mu == pytest.approx(scipy_mu, abs=1e-9)
    assert found.kappa == pytest.approx(scipy_kappa, rel=1e-5)
    assert found.kappa == pytest.approx(kappa, rel=0.06)


@given(kappas, seeds)
def test_the_density_is_scipys(kappa, seed):
    rng = np.random.default_rng(seed)
    mu, v = direction(rng), direction(rng)
    one = fit(5.0 * mean_resultant_length(np.array(kappa)) * mu, np.array(5.0))
    expected = vonmises_fisher(one.mu, float(one.kappa)).logpdf(v)
    ours = log_normaliser(one.kappa) + one.kappa * (one.mu @ v)
    assert ours == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("kappa", [0.0, 1e-8, 1e-3, 1.0, 30.0, 700.0])
def test_the_density_integrates_to_one(kappa):
    c = np.exp(log_normaliser(np.array(kappa)) + kappa)
    total, _ = quad(lambda z: 2 * np.pi * c * np.exp(kappa * (z - 1)), -1, 1, points=[0.9, 0.99])
    assert total == pytest.approx(1.0, rel=1e-6)


def test_too_few_or_opposite_samples_are_uniform():
    resultant = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    found = fit(resultant, np.array([1.0, 2.0]))
    assert found.kappa.tolist() == [0.0, 0.0]
    assert not found.mu.any()


def test_samples_that_agree_to_the_last_digit_stay_finite():
    found = fit(np.array([0.0, 0.0, 5.0]), np.array(5.0))
    assert found.kappa == pytest.approx(1e4)
