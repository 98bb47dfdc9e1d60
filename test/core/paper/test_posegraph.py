"""Pose graph optimisation on SE(3)."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stcalib_ros.core.geometry.se3 import adjoint, exp_se3, inverse, log_se3, right_jacobian_inverse
from stcalib_ros.core.geometry.so3 import exp_so3, rotation_angle
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.paper.posegraph import optimise

seeds = st.integers(0, 2**32 - 1)
lengths = st.floats(1e-6, 3.0)


def twist(rng, length):
    xi = rng.normal(size=6)
    xi[3:] *= length / np.linalg.norm(xi[3:])
    return xi


@given(seeds, lengths)
def test_logarithm_undoes_the_exponential(seed, length):
    xi = twist(np.random.default_rng(seed), length)
    assert log_se3(exp_se3(xi)) == pytest.approx(xi, abs=1e-7)
    assert inverse(exp_se3(xi)) @ exp_se3(xi) == pytest.approx(np.eye(4), abs=1e-12)


@given(seeds, lengths)
def test_the_exponential_is_that_of_the_matrix(seed, length):
    from scipy.linalg import expm

    xi = twist(np.random.default_rng(seed), length)
    rho, (x, y, z) = xi[:3], xi[3:]
    generator = np.zeros((4, 4))
    generator[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    generator[:3, 3] = rho
    assert exp_se3(xi) == pytest.approx(expm(generator), abs=1e-9)


@given(seeds)
def test_the_adjoint_carries_twists_through_a_pose(seed):
    rng = np.random.default_rng(seed)
    T, xi = exp_se3(twist(rng, 1.0)), 0.1 * twist(rng, 1.0)
    assert exp_se3(adjoint(T) @ xi) == pytest.approx(T @ exp_se3(xi) @ inverse(T), abs=1e-9)


@given(seeds, lengths)
def test_the_jacobian_is_the_difference_quotient(seed, length):
    xi = twist(np.random.default_rng(seed), length)
    step = 1e-6
    moved = [
        (log_se3(exp_se3(xi) @ exp_se3(step * e)) - log_se3(exp_se3(xi) @ exp_se3(-step * e)))
        for e in np.eye(6)
    ]
    assert right_jacobian_inverse(xi) == pytest.approx(np.array(moved).T / (2 * step), abs=1e-5)


def rig(rng, n):
    R = Rotation.random(n, rng=rng).as_matrix()
    R[0] = np.eye(3)
    t, offset = rng.uniform(-3, 3, (n, 3)), rng.uniform(-1, 1, n)
    t[0], offset[0] = 0, 0
    return R, t, offset


def edges(rng, truth, *, angle=0.0, metres=0.0, seconds=0.0, pairs=None):
    R, t, offset = truth
    return [
        RelativePose(
            a,
            b,
            exp_so3(angle * rng.normal(size=3)) @ R[a].T @ R[b],
            R[a].T @ (t[b] - t[a]) + metres * rng.normal(size=3),
            float(offset[a] - offset[b] + seconds * rng.normal()),
            ((0, 0),),
            1.0,
        )
        for a, b in pairs or combinations(range(len(R)), 2)
    ]


@given(seeds, st.integers(2, 6))
def test_pairs_without_noise_give_the_truth(seed, n):
    rng = np.random.default_rng(seed)
    R, t, offset = truth = rig(rng, n)
    found = optimise(range(n), edges(rng, truth))
    assert found.R_ref_cam == pytest.approx(R, abs=1e-7)
    assert found.t_ref_cam == pytest.approx(t, abs=1e-6)
    assert found.offset_s == pytest.approx(offset, abs=1e-9)


def test_all_pairs_are_better_than_a_tree():
    whole, tree = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        truth = rig(rng, 5)
        pairs = edges(rng, truth, angle=0.05, metres=0.1, seconds=0.01)
        for used, errors in ((pairs, whole), (pairs[:4], tree)):
            found = optimise(range(5), used)
            angle = rotation_angle(np.swapaxes(truth[0], 1, 2) @ found.R_ref_cam)[1:]
            distance = np.linalg.norm(found.t_ref_cam - truth[1], axis=-1)[1:]
            errors.append([angle.mean(), distance.mean(), np.abs(found.offset_s - truth[2]).mean()])
    ratio = np.mean(whole, axis=0) / np.mean(tree, axis=0)
    assert (ratio < 0.85).all(), ratio


def test_no_small_change_of_a_pose_is_better():
    rng = np.random.default_rng(3)
    truth = rig(rng, 4)
    pairs = edges(rng, truth, angle=0.05, metres=0.1)
    found = optimise(range(4), pairs)

    def cost(R, t):
        total = 0.0
        for h in pairs:
            measured, relative = np.eye(4), np.eye(4)
            measured[:3, :3], measured[:3, 3] = h.R_a_b, h.t_a_b
            relative[:3, :3] = R[h.a].T @ R[h.b]
            relative[:3, 3] = R[h.a].T @ (t[h.b] - t[h.a])
            r = log_se3(np.linalg.inv(measured) @ relative) / np.repeat([0.3, 0.06], 3)
            total += float(r @ r)
        return total

    best = cost(found.R_ref_cam, found.t_ref_cam)
    for _ in range(20):
        R, t = found.R_ref_cam.copy(), found.t_ref_cam.copy()
        k = rng.integers(1, 4)
        R[k] = exp_so3(1e-3 * rng.normal(size=3)) @ R[k]
        t[k] += 1e-3 * rng.normal(size=3)
        assert cost(R, t) > best


def test_a_chain_of_pairs_is_enough():
    rng = np.random.default_rng(4)
    R, t, offset = truth = rig(rng, 4)
    found = optimise(range(4), edges(rng, truth, pairs=[(0, 1), (2, 1), (2, 3)]))
    assert found.R_ref_cam == pytest.approx(R, abs=1e-9)
    assert found.t_ref_cam == pytest.approx(t, abs=1e-9)
    assert found.offset_s == pytest.approx(offset, abs=1e-12)
