"""Whether keypoints lean one way: the test that comes before the biases are estimated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import SMALL

from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.refinement.keypoint_bias.harmonics import trunk_of
from stcalib_ros.core.refinement.keypoint_bias.priors import prior_groups
from stcalib_ros.core.refinement.keypoint_bias.solver import Problem
from stcalib_ros.core.synthetic import simulate


def at_start(stages):
    """The problem of the last round of STBA, and its system without biases."""
    last = stages.iterations[2]
    problem = Problem(last.observations, last.state, trunk_of(stages.skeleton.layout))
    fit = problem.start()
    return fit, problem.eliminate(fit)


@pytest.mark.parametrize(("bias_mm", "hint"), [(0.0, False), (5.0, True)])
def test_biases_of_some_millimetres_leave_a_hint(bias_mm, hint):
    scene = simulate(replace(SMALL, keypoint_bias_mm=bias_mm))
    _, e = at_start(run_stages(scene.recording))
    assert e.hints_at_biases() == hint


@pytest.mark.parametrize(("size", "hint"), [(1.0, False), (1.3, True)])
def test_gradients_as_large_as_noise_makes_them_are_no_hint(small_stages, size, hint):
    _, e = at_start(small_stages)
    noise = np.random.default_rng(0).normal(size=e.gradient.shape)
    gradient = size * np.sqrt(e.observed) * noise
    # Chance alone brings some group above its mean.
    member = prior_groups(noise.shape[-1])
    squares, observed = (v.sum((0, 1)) @ member for v in (gradient**2, e.observed))
    assert (squares > observed).any()
    assert replace(e, gradient=gradient).hints_at_biases() == hint


def test_the_hint_is_the_slope_of_the_marginal_likelihood(small_stages):
    fit, e = at_start(small_stages)
    S = np.linalg.inv(e.inverse) - (1.0 / fit.variance)[..., None] * np.eye(fit.bias.shape[-1])
    assert np.allclose(np.diagonal(S, axis1=-2, axis2=-1), e.observed, rtol=1e-4)
    for group in prior_groups(fit.bias.shape[-1]).T:
        mine = np.flatnonzero(group)
        system, g = S[..., mine[:, None], mine], e.gradient[..., mine]
        v = 1e-8 / np.abs(system).max()
        inverse = np.linalg.inv(system + np.eye(len(mine)) / v)
        volume = np.linalg.slogdet(np.eye(len(mine)) + v * system)[1].sum()
        likelihood = 0.5 * np.einsum("pja,pjab,pjb->", g, inverse, g) - 0.5 * volume
        slope = 0.5 * ((g**2).sum() - e.observed[..., mine].sum())
        assert likelihood / v == pytest.approx(slope, rel=1e-3)
