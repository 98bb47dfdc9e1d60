"""The normal equations of cameras and biases, against differences of the cost."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from stcalib_ros.core.bundle.parameters import Cameras, ParameterLayout
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.refinement.keypoint_bias.normal_equations import (
    _COLUMNS,
    Part,
    _outer,
    follow,
    person_sums,
    project,
)

C, J, N, B = 3, 2, 4, 5
Q = 3 * B + 2 + 2 * C
UNKNOWNS = ParameterLayout(C)
WIDE = 1e6  # px: all image points count fully


def scene(rng):
    """Cameras around two joints of a moving person, with image points that are a bit off."""
    R = np.stack([exp_so3(a) for a in rng.normal(scale=0.4, size=(C, 3))])
    cameras = Cameras(R, rng.normal((0.0, 0.0, 4.0), 0.2, (C, 3)), np.zeros(C))
    X = rng.normal(scale=0.5, size=(3, J, N))
    focal = np.full((C, J, N), 800.0)
    focal[0, 0, 0] = 0.0
    part = Part(
        0,
        slice(0, N),
        np.zeros((C, 2, J, N)),
        focal,
        rng.normal(scale=0.01, size=(C, 1, N)),
        np.zeros(N),
        None,
        rng.normal(size=(3, J, N)),
        rng.normal(size=(3, J, N)),
        np.moveaxis(exp_so3(rng.normal(size=(N, 3))), 0, -1),
        rng.normal(size=(C, B, N)),
        R[:, :2].swapaxes(1, 2),
    )
    for c in range(C):
        u = project(part, c, cameras, X, np.zeros((J, Q))).u
        part.x[c] = u.reshape(2, J, N) + rng.normal(scale=2e-3, size=(2, J, N))
    return part, cameras, X


def moved(cameras, step):
    return UNKNOWNS.retract(cameras, step.reshape(C, -1))


def least_cost(part, cameras, X, bias):
    """Half the sum of squares where the joints suit best."""
    X = follow(part, cameras, X, bias, WIDE, 12)
    return 0.5 * sum(project(part, c, cameras, X, bias).squared.sum() for c in range(C))


def test_gradients_are_those_of_the_cost_with_joints_that_follow():
    part, cameras, X = scene(np.random.default_rng(3))
    none = np.zeros((J, Q))
    X = follow(part, cameras, X, none, WIDE, 12)
    right = person_sums(part, cameras, X, none, WIDE, UNKNOWNS)[:, :, -1]
    by_camera = approx_fprime(
        np.zeros(UNKNOWNS.size), lambda d: least_cost(part, moved(cameras, d), X, none), 1e-6
    )
    by_bias = approx_fprime(
        none.ravel(), lambda b: least_cost(part, cameras, X, b.reshape(none.shape)), 1e-6
    )
    size = np.abs(by_camera).max()
    np.testing.assert_allclose(right[:, : UNKNOWNS.size].sum(0), by_camera, atol=2e-4 * size)
    np.testing.assert_allclose(right[:, UNKNOWNS.size : -1].ravel(), by_bias, atol=2e-4 * size)


@pytest.mark.parametrize(("first", "cameras_moved"), [(0, (0, 1, 2)), (2 + 2 * 2, (2,))])
def test_a_displacement_in_the_images_moves_the_keypoints_of_their_cameras(first, cameras_moved):
    part, cameras, X = scene(np.random.default_rng(5))
    none, bias = np.zeros((2, J, Q))
    bias[1, part.in_body + first :][:2] = (0.02, -0.01)
    for c in range(C):
        plain, moved = (project(part, c, cameras, X, b).Y.reshape(3, J, N) for b in (none, bias))
        expected = np.zeros((3, J, N))
        if c in cameras_moved:
            expected[:2, 1] = [[0.02], [-0.01]]
        np.testing.assert_allclose(moved - plain, expected, atol=1e-12)


def test_products_by_blocks_of_columns_are_those_of_all():
    F = np.random.default_rng(6).normal(size=(J, 5, 3 * _COLUMNS + 7))
    np.testing.assert_allclose(_outer(F), F @ F.swapaxes(1, 2), rtol=1e-12)


def test_joints_that_one_camera_sees_stay():
    part, cameras, X = scene(np.random.default_rng(4))
    part.focal[1:, 1] = 0.0
    after = follow(part, cameras, X, np.zeros((J, Q)), WIDE, 3)
    np.testing.assert_array_equal(after[:, 1], X[:, 1])
    assert not np.array_equal(after[:, 0], X[:, 0])
