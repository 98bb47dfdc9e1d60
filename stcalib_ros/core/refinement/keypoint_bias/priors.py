"""Variances of the priors of the biases, by the largest marginal likelihood.

A variance is the product of one of the person and the group of coefficients (people differ, and so
do the forms of bias), and a factor of the joint (hips are hidden more often than the head).
"""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.refinement.evidence import renewed_variance
from stcalib_ros.core.refinement.keypoint_bias.harmonics import DEGREE_OF, DEGREES

_ALTERNATIONS = 4
"""Count. Renewals of the two factors in turn. Numerical: each is renewed in every step anyway."""

_LEAST_FACTOR = 1e-4
"""Ratio. Smallest factor of a joint: a hundredth of the usual standard deviation. Numerical."""


def prior_groups(size: int) -> Float64Array:
    """Which coefficients (q,) of a joint have a prior of the same variance, (q, G), one of 1.

    Parameters
    ----------
    size : int
        Number q: 3 B of harmonics, one group for each degree; 2 of the images of all cameras
        together, and two of the images of each.
    """
    k = 3 * len(DEGREE_OF)
    group = np.full(size, len(DEGREES) + 1)
    group[:k] = np.searchsorted(DEGREES, np.tile(DEGREE_OF, 3))
    group[k : k + 2] = len(DEGREES)
    return np.asarray(np.eye(len(DEGREES) + 2)[group])


def renewed_variances(bias: Float64Array, determined: Float64Array, least: float) -> Float64Array:
    """Estimate the variances (P, J, q) of the priors of the coefficients, one step.

    Parameters
    ----------
    bias : (P, J, q) ndarray
        Coefficients by person and joint.
    determined : (P, J, q) ndarray
        Fraction of each that the keypoints determine.
    least : float
        Smallest variance.
    """
    member = prior_groups(bias.shape[-1])
    squares, numbers = bias**2 @ member, determined @ member
    of_person, of_joint = squares, np.ones((1, squares.shape[1], 1))
    for _ in range(_ALTERNATIONS):
        of_person = renewed_variance(
            (squares / of_joint).sum(1, keepdims=True), numbers.sum(1, keepdims=True), least
        )
        of_joint = renewed_variance(
            (squares / of_person).sum((0, 2), keepdims=True),
            numbers.sum((0, 2), keepdims=True),
            _LEAST_FACTOR,
        )
    return np.asarray(np.maximum(of_person * of_joint, least) @ member.T)
