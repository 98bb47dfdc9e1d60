"""Loops of rotations, by rotations that fit together and by derivatives of those that do not."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.registration.rotation_loops import rotation_loops

A, B = np.array([0, 0, 0, 1, 1, 2]), np.array([1, 2, 3, 2, 3, 3])


@pytest.fixture
def rotations() -> np.ndarray:
    """R_a_b (6, 3, 3) of the pairs of four cameras."""
    R_ref_cam = exp_so3(np.random.default_rng(0).normal(size=(4, 3)))
    return np.swapaxes(R_ref_cam[A], -1, -2) @ R_ref_cam[B]


def test_loops_of_one_rig_are_closed(rotations):
    loops = rotation_loops(A, B)
    assert len(loops.ab) == 4
    assert_allclose(loops.turns(rotations), 0.0, atol=1e-12)


def test_a_pair_that_is_turned_is_seen_in_its_two_loops(rotations):
    loops = rotation_loops(A, B)
    rotations[4] = exp_so3(np.array([0.0, 0.3, 0.0])) @ rotations[4]
    turned = np.linalg.norm(loops.turns(rotations), axis=-1)
    own = (loops.ab == 4) | (loops.bc == 4) | (loops.ac == 4)
    assert own.sum() == 2
    assert_allclose(turned, 0.3 * own, atol=1e-12)


def test_derivatives_are_those_by_differences(rotations):
    loops = rotation_loops(A, B)
    for pair in range(6):
        total = np.zeros((4, 3, 3))
        for numbers, J in loops.derivatives(rotations):
            total[numbers == pair] += J[numbers == pair]
        for k in range(3):
            moved = rotations.copy()
            moved[pair] = exp_so3(1e-6 * np.eye(3)[k]) @ moved[pair]
            assert_allclose(loops.turns(moved) / 1e-6, total[..., k], atol=1e-5)


def test_share_is_that_of_independent_loops():
    assert rotation_loops(A, B).share == pytest.approx(3 / 4)
    assert rotation_loops(A[:3], B[:3]).share == 0.0
    assert len(rotation_loops(A[:1], B[:1]).ab) == 0
