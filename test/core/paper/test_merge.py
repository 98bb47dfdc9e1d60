"""One association of all cameras along a spanning tree."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stcalib_ros.core.geometry.graphs import spanning_tree
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.paper.merge import merge
from stcalib_ros.core.paper.registration import PairRegistration

STEP_S = 1 / 30
WINDOW = 5
STARTS = np.array([0, 10, 20])
seeds = st.integers(0, 2**32 - 1)


def cameras(n, n_tracks):
    """Cameras that hold nothing but their number of tracks and their stamps."""
    empty = np.zeros((0, 17, 2))
    track = LiftedTrack(
        0, np.zeros(0, dtype=np.int64), empty, empty[..., 0], np.zeros((0, 17, 3)), np.zeros((0, 3))
    )
    return [
        LiftedCamera(f"cam{c}", STEP_S * np.arange(25.0), (track,) * n_tracks) for c in range(n)
    ]


def rig(n, offset_s=None):
    offset = np.zeros(n) if offset_s is None else np.array(offset_s)
    return Rig(np.arange(n), np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)), offset, 1.0)


def pair(a, b, matches, support=1.0):
    h = RelativePose(a, b, np.eye(3), np.array([1.0, 0, 0]), 0.0, (), support)
    return PairRegistration(h, STARTS, np.array(matches, dtype=np.int64).reshape(-1, 3), 0.1)


def merged(n, n_tracks, pairs, **more):
    return merge(
        cameras(n, n_tracks),
        rig(n, **more),
        pairs,
        start_s=0.0,
        step_s=STEP_S,
        window=WINDOW,
    )


def slots_of(association):
    """Slots in which the windows of the reference lie."""
    return association.slot(STEP_S * (STARTS + WINDOW / 2))


def test_matches_are_followed_from_camera_to_camera():
    every = [(w, p, (p + 1) % 3) for w in range(3) for p in range(3)]
    found = merged(3, 3, [pair(0, 1, every), pair(1, 2, every)])
    at = slots_of(found)
    a, b, c = (person[:, at] for person in found.person_of)
    for p in range(3):
        assert (a[p] == b[(p + 1) % 3]).all()
        assert (a[p] == c[(p + 2) % 3]).all()
    assert found.n_persons == 3


def test_an_exchange_of_ids_is_followed_from_window_to_window():
    straight, crossed = [(0, 0, 0), (0, 1, 1)], [(w, p, 1 - p) for w in (1, 2) for p in (0, 1)]
    found = merged(2, 2, [pair(0, 1, straight + crossed)])
    a, b = (person[:, slots_of(found)] for person in found.person_of)
    assert a[:, 0].tolist() == b[:, 0].tolist()
    assert a[:, 1].tolist() == b[::-1, 1].tolist()


def test_the_pair_with_least_support_has_no_say():
    same = [(w, p, p) for w in range(3) for p in range(2)]
    wrong = [(w, p, 1 - p) for w in range(3) for p in range(2)]
    pairs = [pair(0, 1, same, 3.0), pair(1, 2, same, 2.0), pair(0, 2, wrong, 1.0)]
    found = merged(3, 2, pairs)
    a, _, c = (person[:, slots_of(found)] for person in found.person_of)
    assert np.array_equal(a, c)
    found = merged(3, 2, [*pairs[:2], pair(0, 2, wrong, 4.0)])
    a, _, c = (person[:, slots_of(found)] for person in found.person_of)
    assert np.array_equal(a, c[::-1])


@given(seeds)
def test_whatever_the_pairs_say_nobody_is_twice_in_one_camera(seed):
    rng = np.random.default_rng(seed)
    pairs = [
        pair(
            a,
            b,
            [
                (w, p, q)
                for w in range(3)
                for p, q in enumerate(rng.permutation(3))
                if rng.integers(3)
            ],
            rng.uniform(),
        )
        for a, b in combinations(range(4), 2)
    ]
    found = merged(4, 3, pairs, offset_s=rng.uniform(-0.3, 0.3, 4))
    for person in found.person_of:
        for slot in person.T:
            named = slot[slot >= 0]
            assert len(named) == len(set(named))


def test_tracks_without_a_match_are_nobody():
    found = merged(2, 2, [pair(0, 1, [(w, 0, 0) for w in range(3)])])
    assert [(person[1] == -1).all() for person in found.person_of] == [True, True]


def test_the_tree_takes_the_most_wanted_edges_that_reach_all():
    a, b = np.array([0, 1, 0, 2]), np.array([1, 2, 2, 3])
    assert spanning_tree(a, b, np.array([2, 1, 0, 3]), 4) == [(2, True), (1, False), (3, True)]
