"""Projection matrices from points of space."""

from __future__ import annotations

import numpy as np
import pytest

from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.reconstruction.projective import decomposed_projection, linear_projection

K = np.array([[0.4, 0.0, -0.45], [0.0, 0.35, 0.2], [0.0, 0.0, 1.0]])
R = exp_so3(np.array([0.3, -0.2, 1.0]))
T = np.array([0.2, -0.1, 4.0])
P = K @ np.concatenate([R, T[:, None]], 1)


def points(rng, n=80):
    X = rng.uniform(-1, 1, (n, 3))
    image = X @ P[:, :3].T + P[:, 3]
    return X, image[:, :2] / image[:, 2:]


@pytest.mark.parametrize("n_wrong", [0, 8])
def test_lens_and_pose_are_found_without_a_start_and_despite_outliers(rng, n_wrong):
    X, x = points(rng)
    x[:n_wrong] += rng.uniform(0.05, 0.1, (n_wrong, 2))
    found = decomposed_projection(linear_projection(X, x))
    assert found is not None
    for one, true in zip(found, (K, R, T), strict=True):
        np.testing.assert_allclose(one, true, atol=2e-3)


def test_a_mirrored_image_has_no_camera(rng):
    X, x = points(rng)
    assert decomposed_projection(linear_projection(X, x * [-1.0, 1.0])) is None
