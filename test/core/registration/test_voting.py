"""Rotation, lag, matches and translation of two cameras, from bones and positions alone."""

from __future__ import annotations

import itertools
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from core_helpers import EXACT, FRAME_S, lifted, true_rig

from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.options import RegistrationOptions
from stcalib_ros.core.registration import voting
from stcalib_ros.core.registration.correlation import PairCovariance
from stcalib_ros.core.registration.resampling import GridTracks, sample_camera
from stcalib_ros.core.registration.voting import _greedy, register_pair
from stcalib_ros.core.synthetic import simulate

MAX_LAG = 20


def grid(camera, skeleton, n=100):
    return sample_camera(camera, skeleton, start=-10 * FRAME_S, step=FRAME_S, n=n)


def register(a, b, *, max_lag=MAX_LAG):
    return register_pair(0, 1, a, b, max_lag, RegistrationOptions())


def late(camera, frames):
    return replace(camera, stamps=camera.stamps + frames * FRAME_S)


def only(tracks, rows):
    """Some of the tracks of a grid, in the given order."""
    return GridTracks(
        tracks.name,
        tracks.start,
        tracks.step,
        tracks.oriented[rows],
        tracks.position[rows],
    )


def joined(*grids):
    return GridTracks(
        grids[0].name,
        grids[0].start,
        grids[0].step,
        *(np.concatenate([getattr(g, n) for g in grids]) for n in ("oriented", "position")),
    )


def person_rows_of(scene, camera):
    """True person of each track of a camera without id switches."""
    own = scene.track_persons[scene.recording.cameras[camera].name]
    return [int(own[t.track_id][0]) for t in scene.recording.cameras[camera].tracks]


@pytest.fixture(scope="module")
def pair(exact_lifted):
    skeleton, cameras = exact_lifted
    return grid(cameras[0], skeleton), grid(cameras[1], skeleton)


def relative(scene, a, b):
    rig = true_rig(scene)
    R_a = rig.R_ref_cam[a]
    return R_a.T @ rig.R_ref_cam[b], R_a.T @ (rig.t_ref_cam[b] - rig.t_ref_cam[a])


@pytest.mark.parametrize("frames", [-9, 0, 6])
def test_an_exact_scene_gives_rotation_lag_translation_and_matches(
    exact_scene, exact_lifted, frames
):
    skeleton, cameras = exact_lifted
    a, b = grid(cameras[0], skeleton), grid(late(cameras[1], frames), skeleton)
    best = register(a, b)[0]
    R_a_b, t_a_b = relative(exact_scene, 0, 1)
    assert rotation_angle(best.R_a_b.T @ R_a_b) < 1e-4
    np.testing.assert_allclose(best.t_a_b, t_a_b, atol=1e-3)
    assert best.lag_s == pytest.approx(frames * FRAME_S)
    p, q = person_rows_of(exact_scene, 0), person_rows_of(exact_scene, 1)
    assert len(best.matches) == 3
    assert all(p[i] == q[j] for i, j in best.matches)
    assert np.isnan(best.epipolar_px)


def test_a_reversed_pair_is_the_inverse(pair):
    forth, back = register(*pair)[0], register(*pair[::-1])[0]
    np.testing.assert_allclose(back.R_a_b, forth.R_a_b.T, atol=1e-4)
    np.testing.assert_allclose(back.t_a_b, -forth.R_a_b.T @ forth.t_a_b, atol=1e-3)
    assert back.lag_s == -forth.lag_s
    assert {(q, p) for p, q in back.matches} == set(forth.matches)
    assert back.support == pytest.approx(forth.support, rel=1e-4)


def test_the_best_is_first_and_all_are_distinct(pair):
    found = register(*pair)
    support = [h.support for h in found]
    assert support == sorted(support, reverse=True)
    assert len(found) <= RegistrationOptions().n_hypotheses


def test_a_lag_out_of_range_is_not_found(exact_lifted):
    skeleton, cameras = exact_lifted
    a, b = grid(cameras[0], skeleton), grid(late(cameras[1], 9), skeleton)
    assert all(abs(h.lag_s) <= 4 * FRAME_S + 1e-9 for h in register(a, b, max_lag=4))


def test_a_track_matches_all_fragments_of_its_person(pair):
    a, b = pair
    begin, end = only(b, [0]), only(b, [0])
    begin.oriented[:, 50:], begin.position[:, 50:] = 0, np.nan
    end.oriented[:, :55], end.position[:, :55] = 0, np.nan
    whole = register(a, b)[0]
    person = next(p for p, q in whole.matches if q == 0)
    broken = register(a, joined(begin, end, only(b, [1, 2])))[0]
    assert {(person, 0), (person, 1)} < set(broken.matches)
    assert len(broken.matches) == 4


@pytest.mark.parametrize("twice", [0, 1])
def test_two_people_at_one_time_are_not_one(pair, twice):
    # Somebody at the same place who moves alike: a second detection of the same person.
    grids = list(pair)
    grids[twice] = joined(grids[twice], only(grids[twice], [0]))
    best = register(*grids)[0]
    assert len(best.matches) == 3
    assert len({p for p, _ in best.matches}) == len({q for _, q in best.matches}) == 3


def lookalike(a, b, offset_a, R_a_b):
    """Grids with one more person, who moves like the first and stands elsewhere."""
    match = register(a, b)[0].matches[0]
    twin_a, twin_b = only(a, [match[0]]), only(b, [match[1]])
    twin_a.position[...] += offset_a
    twin_b.position[...] += R_a_b.T @ offset_a
    return joined(only(a, [match[0]]), twin_a), joined(only(b, [match[1]]), twin_b)


@pytest.mark.parametrize("swapped", [False, True])
def test_people_who_move_alike_are_told_apart_by_where_they_stand(exact_scene, pair, swapped):
    R_a_b, t_a_b = relative(exact_scene, 0, 1)
    a, b = lookalike(*pair, np.array([1.2, 0.0, 0.9]), R_a_b)
    if swapped:
        b = only(b, [1, 0])
    best = register(a, b)[0]
    assert set(best.matches) == ({(0, 1), (1, 0)} if swapped else {(0, 0), (1, 1)})
    np.testing.assert_allclose(best.t_a_b, t_a_b, atol=1e-3)


def test_strangers_find_little_support(exact_lifted, pair):
    skeleton, strangers = lifted(simulate(replace(EXACT, seed=5)).recording)
    friends = register(*pair)[0]
    found = register(pair[0], grid(strangers[1], skeleton))
    assert not found or found[0].support < 0.6 * friends.support


def test_nobody_is_no_hypothesis(pair):
    a, b = pair
    assert register(a, only(b, [])) == ()
    assert register(only(a, []), b) == ()


def test_people_at_other_times_are_no_hypothesis(pair):
    a, b = only(pair[0], [0, 1, 2]), only(pair[1], [0, 1, 2])
    a.oriented[:, 30:], a.position[:, 30:] = 0, np.nan
    b.oriented[:, :60], b.position[:, :60] = 0, np.nan
    assert register(a, b) == ()


@pytest.mark.parametrize("shared", [11, 12])
def test_twelve_shared_samples_are_needed(pair, shared):
    a, b = only(pair[0], [0, 1, 2]), pair[1]
    end = 10 + shared
    a.oriented[:, end:], a.position[:, end:] = 0, np.nan
    assert bool(register(a, b)) == (shared >= 12)


def dense_greedy(gain, conflict):
    """Greedy choice by a table of all conflicts, one row after the other."""
    chosen = np.zeros(gain.shape, dtype=bool)
    for row, left in enumerate(gain.copy()):
        while left[best := int(left.argmax())] > 0:
            chosen[row, best] = True
            left[conflict[best]] = -np.inf
    return chosen


@pytest.mark.parametrize("seed", range(20))
def test_greedy_choice_is_that_by_a_dense_table_of_conflicts(seed):
    rng = np.random.default_rng(seed)
    P, Q = rng.integers(1, 8, 2)
    overlap_a, overlap_b = (
        (m := rng.uniform(size=(n, n)) < 0.4) | m.T | np.eye(n, dtype=bool) for n in (P, Q)
    )
    pairs = np.indices((P, Q)).reshape(2, -1).T
    gain = rng.normal(size=(5, P * Q))
    same_p = np.eye(P, dtype=bool)[:, None, :, None] & overlap_b[None, :, None, :]
    same_q = np.eye(Q, dtype=bool)[None, :, None, :] & overlap_a[:, None, :, None]
    conflict = (same_p | same_q).reshape(P * Q, P * Q)
    np.testing.assert_array_equal(
        _greedy(gain, pairs, overlap_a, overlap_b), dense_greedy(gain, conflict)
    )


def fragments(tracks, n):
    """The same tracks, each cut into n pieces with an id of their own."""
    N = tracks.position.shape[1]
    cuts = np.linspace(0, N, n + 1).astype(int)
    pieces = []
    for begin, end in itertools.pairwise(cuts):
        oriented = np.zeros_like(tracks.oriented)
        position = np.full_like(tracks.position, np.nan)
        oriented[:, begin:end] = tracks.oriented[:, begin:end]
        position[:, begin:end] = tracks.position[:, begin:end]
        pieces.append(replace(tracks, oriented=oriented, position=position))
    return joined(*pieces)


def covariance_at_lag_zero(a, b, *, max_lag):
    """What `cross_covariance` gives for no lag but zero, without thousands of transforms."""
    P, N, D, _ = a.oriented.shape
    flat = [t.oriented.transpose(0, 3, 1, 2).reshape(-1, N * D) for t in (a, b)]
    S = (flat[0] @ flat[1].T).reshape(P, 3, -1, 3).transpose(0, 2, 1, 3)[:, :, None]
    mass = a.weight.reshape(P, -1) @ b.weight.reshape(len(b.weight), -1).T
    overlap = a.present.astype(float) @ b.present.astype(float).T
    return PairCovariance(
        S.astype(float), mass.astype(float)[..., None], overlap[..., None], np.array([0])
    )


def test_hundreds_of_fragments_a_camera_need_little_memory(monkeypatch):
    """A table of the conflicts of all track pairs would take 26 GB for 400 fragments a camera."""
    monkeypatch.setattr(voting, "cross_covariance", covariance_at_lag_zero)
    rng = np.random.default_rng(1)
    N, n_people, n_pieces = 2000, 4, 100
    directions = rng.standard_normal((n_people, N, 6, 3))
    oriented = (directions / np.linalg.norm(directions, axis=-1, keepdims=True)).astype(np.float32)
    whole = GridTracks("a", 0.0, FRAME_S, oriented, rng.uniform(-2, 2, (n_people, N, 3)))
    cut = fragments(whole, n_pieces)
    assert len(cut.position) == 400
    few = RegistrationOptions(n_candidates=8, n_hypotheses=2)
    tracemalloc.start()
    found = register_pair(0, 1, cut, replace(cut, name="b"), 0, few)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3e8
    assert rotation_angle(found[0].R_a_b) < 1e-3
    assert {(p, p) for p in range(400)} == set(found[0].matches)
