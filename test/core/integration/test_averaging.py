"""One rig out of many pair hypotheses."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from core_helpers import FRAME_S
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stcalib_ros.core.geometry.graphs import connected_groups
from stcalib_ros.core.geometry.so3 import exp_so3, rotation_angle
from stcalib_ros.core.integration.averaging import credible, integrate, reliability
from stcalib_ros.core.integration.limits import EPIPOLAR_SCALE_PX, MIN_RELIABILITY_RATIO
from stcalib_ros.core.model.relative_pose import RelativePose

seeds = st.integers(0, 2**32 - 1)


def random_rig(rng, n):
    """Poses and offsets of n cameras, the first at the origin."""
    R = Rotation.random(n, rng=rng).as_matrix()
    R[0] = np.eye(3)
    t, offset = rng.uniform(-5, 5, (n, 3)), rng.uniform(-1, 1, n)
    t[0], offset[0] = 0, 0
    return R, t, offset


def hypothesis_of(rig, a, b, *, support=1.0, epipolar_px=1.0):
    R, t, offset = rig
    return RelativePose(
        a,
        b,
        R[a].T @ R[b],
        R[a].T @ (t[b] - t[a]),
        float(offset[a] - offset[b]),
        ((0, 0),),
        support,
        epipolar_px,
    )


def all_pairs(rig, n, **more):
    return [hypothesis_of(rig, a, b, **more) for a, b in combinations(range(n), 2)]


def noisy(rng, h, *, angle=0.0, metres=0.0, frames=0.0):
    return RelativePose(
        h.a,
        h.b,
        exp_so3(angle * rng.normal(size=3)) @ h.R_a_b,
        h.t_a_b + metres * rng.normal(size=3),
        h.lag_s + frames * FRAME_S * rng.normal(),
        h.matches,
        h.support,
        h.epipolar_px,
    )


def solve(cameras, hypotheses, seed=0, n_trees=100):
    return integrate(
        cameras, hypotheses, frame_s=FRAME_S, n_trees=n_trees, rng=np.random.default_rng(seed)
    )


def assert_same(found, rig, *, angle, metres, frames):
    R, t, offset = rig
    assert rotation_angle(np.swapaxes(found.R_ref_cam, 1, 2) @ R).max() < angle
    assert np.linalg.norm(found.t_ref_cam - t, axis=-1).max() < metres
    assert np.abs(found.offset_s - offset).max() < frames * FRAME_S


@given(seeds, st.integers(2, 6))
def test_consistent_hypotheses_give_the_rig(seed, n):
    rig = random_rig(np.random.default_rng(seed), n)
    found = solve(range(n), all_pairs(rig, n), n_trees=5)
    assert_same(found[0], rig, angle=1e-7, metres=1e-6, frames=1e-6)
    np.testing.assert_array_equal(found[0].cameras, np.arange(n))
    assert found[0].support == pytest.approx(n * (n - 1) / 2 / (1 + 1 / 64), rel=1e-6)


@given(seeds)
def test_a_chain_is_enough_in_either_direction(seed):
    rng = np.random.default_rng(seed)
    rig = random_rig(rng, 4)
    chain = [hypothesis_of(rig, *pair) for pair in ((1, 0), (1, 2), (3, 2))]
    assert_same(solve(range(4), chain)[0], rig, angle=1e-7, metres=1e-6, frames=1e-6)


def test_the_first_of_the_cameras_is_the_reference(rng):
    rig = random_rig(rng, 4)
    found = solve([2, 0, 3], [h for h in all_pairs(rig, 4) if 1 not in (h.a, h.b)])[0]
    R, t, offset = rig
    order = [2, 0, 3]
    expected = R[2].T @ R[order], (t[order] - t[2]) @ R[2], offset[order] - offset[2]
    np.testing.assert_array_equal(found.cameras, order)
    assert_same(found, expected, angle=1e-7, metres=1e-6, frames=1e-6)


def outliers(rng, hypotheses, share):
    """A share of the hypotheses replaced by anything."""
    out = list(hypotheses)
    for k in rng.permutation(len(out))[: round(share * len(out))]:
        h = out[k]
        R = Rotation.random(rng=rng).as_matrix()
        lag_s = float(rng.uniform(-2, 2))
        out[k] = RelativePose(
            h.a, h.b, R, rng.uniform(-5, 5, 3), lag_s, h.matches, h.support, h.epipolar_px
        )
    return out


@pytest.mark.parametrize("seed", range(10))
def test_a_third_of_wrong_hypotheses_does_no_harm(seed):
    rng = np.random.default_rng(seed)
    rig = random_rig(rng, 6)
    given_ = outliers(rng, all_pairs(rig, 6), 0.3)
    good = solve(range(6), given_)[0]
    assert_same(good, rig, angle=2e-3, metres=0.02, frames=0.02)


def test_averaging_is_better_than_the_hypotheses_with_the_reference():
    ours, theirs = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        R, t, offset = rig = random_rig(rng, 6)
        given_ = [noisy(rng, h, angle=0.02, metres=0.1, frames=0.2) for h in all_pairs(rig, 6)]
        found = solve(range(6), given_, n_trees=30)[0]
        star = [h for h in given_ if h.a == 0]
        for R_, t_, offset_, errors in (
            (found.R_ref_cam[1:], found.t_ref_cam[1:], found.offset_s[1:], ours),
            (
                *(np.array([getattr(h, n) for h in star]) for n in ("R_a_b", "t_a_b")),
                -np.array([h.lag_s for h in star]),
                theirs,
            ),
        ):
            errors.append(
                [
                    rotation_angle(np.swapaxes(R_, 1, 2) @ R[1:]).mean(),
                    np.linalg.norm(t_ - t[1:], axis=-1).mean(),
                    np.abs(offset_ - offset[1:]).mean(),
                ]
            )
    # Six cameras: least squares leaves 1/3 of the variance, robust averaging a bit more.
    ratio = np.mean(ours, axis=0) / np.mean(theirs, axis=0)
    assert (ratio < [0.75, 0.8, 0.75]).all(), ratio


def test_of_several_hypotheses_of_a_pair_the_consistent_one_counts(rng):
    rig, other = random_rig(rng, 4), random_rig(rng, 4)
    # The wrong ones have more support, but every one of them is alone.
    wrong = [
        noisy(rng, h, angle=1.0, metres=3.0, frames=20) for h in all_pairs(other, 4, support=1.5)
    ]
    found = solve(range(4), wrong + all_pairs(rig, 4), n_trees=300)[0]
    assert_same(found, rig, angle=5e-3, metres=0.05, frames=0.1)


def test_rival_rigs_are_all_found_the_best_first(rng):
    rigs = [random_rig(rng, 2) for _ in range(3)]
    given_ = [hypothesis_of(r, 0, 1, support=s) for r, s in zip(rigs, (1.0, 3.0, 2.0), strict=True)]
    found = solve(range(2), given_)
    assert len(found) == 3
    for one, k in zip(found, (1, 2, 0), strict=True):
        assert_same(one, rigs[k], angle=1e-2, metres=0.1, frames=0.1)
    assert [f.support for f in found] == sorted((f.support for f in found), reverse=True)


def test_a_hypothesis_that_the_key_points_contradict_counts_for_less(rng):
    rig, other = random_rig(rng, 2), random_rig(rng, 2)
    given_ = [
        hypothesis_of(rig, 0, 1, support=1.0, epipolar_px=1.0),
        hypothesis_of(other, 0, 1, support=3.0, epipolar_px=40.0),
    ]
    assert_same(solve([0, 1], given_)[0], rig, angle=1e-3, metres=0.02, frames=0.01)


def test_the_same_seed_gives_the_same_rig(rng):
    rig = random_rig(rng, 5)
    given_ = outliers(rng, all_pairs(rig, 5), 0.4)
    one, two = solve(range(5), given_, seed=7)[0], solve(range(5), given_, seed=7)[0]
    for name in ("R_ref_cam", "t_ref_cam", "offset_s"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def test_groups_hang_together_through_hypotheses(rng):
    rig = random_rig(rng, 7)
    hypotheses = [hypothesis_of(rig, *pair) for pair in ((0, 2), (2, 5), (6, 1), (5, 0))]
    assert connected_groups([0, 1, 2, 3, 4, 5, 6], hypotheses) == [[0, 2, 5], [1, 6], [3], [4]]
    assert connected_groups([3, 4], []) == [[3], [4]]
    assert connected_groups([6, 1, 3], [hypothesis_of(rig, 1, 6)]) == [[6, 1], [3]]


# What connects two cameras


def test_what_keypoints_contradict_is_less_reliable(rng):
    one = hypothesis_of(random_rig(rng, 2), 0, 1, support=100.0, epipolar_px=0.0)
    assert reliability(one) == 100
    assert reliability(replace(one, epipolar_px=EPIPOLAR_SCALE_PX)) == 50


def test_a_pair_that_is_much_less_reliable_than_both_its_cameras_elsewhere_is_dropped(rng):
    """Two groups of cameras that see different people."""
    rig = random_rig(rng, 4)
    kept = [hypothesis_of(rig, *pair, support=1000.0) for pair in ((0, 1), (2, 3))]
    limit = 1000.0 * MIN_RELIABILITY_RATIO
    strangers = hypothesis_of(rig, 1, 2, support=0.9 * limit)
    assert credible([kept[0], strangers, kept[1]]) == tuple(kept)
    friends = replace(strangers, support=1.1 * limit)
    assert credible([*kept, friends]) == (*kept, friends)


def test_a_camera_that_has_little_is_compared_with_what_it_has(rng):
    rig = random_rig(rng, 3)
    hypotheses = [
        hypothesis_of(rig, 0, 1, support=1000.0),
        hypothesis_of(rig, 1, 2, support=30.0),
        hypothesis_of(rig, 0, 2, support=7.0),
        hypothesis_of(rig, 0, 2, support=5.0),
    ]
    assert credible(hypotheses) == tuple(hypotheses[:3])
    assert credible(hypotheses[3:]) == (hypotheses[3],)
    assert credible([]) == ()


@given(seeds)
def test_the_best_of_every_camera_is_kept(seed):
    rng = np.random.default_rng(seed)
    rig = random_rig(rng, 5)
    hypotheses = [
        hypothesis_of(rig, a, b, support=10.0 ** rng.uniform(0, 4), epipolar_px=rng.uniform(0, 30))
        for a, b in combinations(range(5), 2)
        for _ in range(2)
    ]
    kept = credible(hypotheses)
    for c in range(5):
        own = [h for h in hypotheses if c in (h.a, h.b)]
        assert max(own, key=reliability) in kept
    assert [h for h in hypotheses if h in kept] == list(kept)
