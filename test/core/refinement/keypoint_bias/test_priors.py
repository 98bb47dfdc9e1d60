"""Variances of the priors of the biases."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.refinement.keypoint_bias.harmonics import DEGREE_OF
from stcalib_ros.core.refinement.keypoint_bias.priors import prior_groups, renewed_variances

C, P, J = 4, 5, 40
Q = 3 * len(DEGREE_OF) + 2 + 2 * C


def test_every_coefficient_has_the_prior_of_its_degree_or_of_the_images():
    member = prior_groups(Q)
    np.testing.assert_array_equal(member.sum(0), [3 * 3, 3 * 5, 3 * 7, 2, 2 * C])
    np.testing.assert_array_equal(member.sum(1), 1)
    degree = np.tile(DEGREE_OF, 3)
    np.testing.assert_array_equal(member[: len(degree), :3] @ [1, 2, 3], degree)


def test_variances_of_persons_forms_and_joints_are_found_again():
    rng = np.random.default_rng(2)
    member = prior_groups(Q)
    of_person = rng.uniform(0.5, 5.0, (P, 1, member.shape[1]))
    of_joint = rng.uniform(0.3, 3.0, (1, J, 1))
    truth = (of_person * of_joint) @ member.T
    bias = np.sqrt(truth) * rng.standard_normal((P, J, Q))
    found = renewed_variances(bias, np.ones(bias.shape), 1e-12)
    assert np.std(np.log(found / truth)) < 0.2
    assert abs(np.mean(np.log(found / truth))) < 0.05


def test_variances_are_products_and_only_what_is_determined_counts():
    rng = np.random.default_rng(3)
    bias, determined = rng.standard_normal((P, J, Q)), rng.uniform(0.0, 1.0, (P, J, Q))
    bias[:, 7], determined[:, 7] = 0.0, 0.0
    found = renewed_variances(bias, determined, 1e-12)
    others = np.delete(found, 7, axis=1)
    ratio = others[:, :1] / others
    np.testing.assert_allclose(ratio, np.broadcast_to(ratio[:1, :, :1], ratio.shape), rtol=1e-9)
    without = renewed_variances(*(np.delete(v, 7, axis=1) for v in (bias, determined)), 1e-12)
    np.testing.assert_allclose(others, without, rtol=1e-9)
