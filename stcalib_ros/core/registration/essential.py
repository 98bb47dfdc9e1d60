"""From what agrees on an essential matrix to a relative pose."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.geometry.epipolar import decompose_essential, depths, sampson
from stcalib_ros.core.geometry.robust import MIN_NOISE_PX, NOISE_MARGIN, RMS_OVER_MEDIAN
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.registration.correspondences import Correspondences
from stcalib_ros.core.registration.epipolar_correlation import best_essential, noise_of_moments

_REWEIGHTINGS = 3
"""Passes of iteratively reweighted least squares. Numerical: the refinement goes on from there."""


def robust_essential(E: Float64Array, c: Correspondences) -> Float64Array:
    """Return the essential matrix of most correspondences, near one of all of them.

    It is not projected to two equal singular values: in between, that would lose its minimum.

    Parameters
    ----------
    E : (3, 3) ndarray
        Where it starts from, ``x_a^T E x_b = 0``.
    c : Correspondences
    """
    products = (c.x_a[:, :, None] * c.x_b[:, None, :]).reshape(-1, 9)
    for _ in range(_REWEIGHTINGS):
        r = sampson(E, c.x_a, c.x_b) * c.focal
        scale = max(MIN_NOISE_PX, NOISE_MARGIN * RMS_OVER_MEDIAN * float(np.median(np.abs(r))))
        w = 1.0 / (1.0 + (r / scale) ** 2)
        M = (products * w[:, None]).T @ products
        N = noise_of_moments((c.x_a * w[:, None]).T @ c.x_a, (c.x_b * w[:, None]).T @ c.x_b)
        _, E = best_essential(M, N)
    return E


def pose_by_cheirality(E: Float64Array, c: Correspondences) -> tuple[Float64Array, Float64Array]:
    """Return R_a_b and the unit t_a_b of an essential matrix with most points ahead of both."""

    def ahead(pose: tuple[Float64Array, Float64Array]) -> int:
        depth_a, depth_b = depths(*pose, c.x_a, c.x_b)
        return int(((depth_a > 0.0) & (depth_b > 0.0)).sum())

    return max(decompose_essential(E), key=ahead)
