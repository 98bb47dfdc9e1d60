"""Who is who across views when poses and clocks are known."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from core_helpers import EXACT, FRAME_S, lifted, true_rig

from stcalib_ros.core.integration.association import SLOT_SAMPLES, _average_link, associate
from stcalib_ros.core.model.recording import Track
from stcalib_ros.core.synthetic import simulate

FLOOR_PX = 8.0


def exchanged(camera, i, j, frame):
    """The tracker of a camera exchanges two tracks from an image on."""

    def joined(first, second):
        parts = [(first, first.frames < frame), (second, second.frames >= frame)]
        return Track(
            first.track_id,
            *(
                np.concatenate([getattr(t, name)[rows] for t, rows in parts])
                for name in ("frames", "keypoints", "joints", "scores")
            ),
        )

    tracks = list(camera.tracks)
    tracks[i], tracks[j] = joined(tracks[i], tracks[j]), joined(tracks[j], tracks[i])
    return replace(camera, tracks=tuple(tracks))


@pytest.fixture(scope="module")
def long_scene():
    return simulate(replace(EXACT, n_frames=250, seed=1))


def true_person(scene, association, exchange=None):
    """Per camera, the true person of every track in every slot, -1 where it was not seen."""
    out = []
    for c, camera in enumerate(scene.recording.cameras):
        own = scene.track_persons[camera.name]
        table = np.full(association.person_of[c].shape, -1)
        for p, track in enumerate(camera.tracks):
            slots = association.slot(camera.stamps[track.frames])
            for s in np.unique(slots):
                table[p, s] = np.bincount(own[track.track_id][slots == s]).argmax()
        if exchange is not None and c == exchange[0]:
            i, j, slot = exchange[1:]
            table[i, slot:], table[j, slot:] = table[j, slot:].copy(), table[i, slot:].copy()
        out.append(table)
    return out


def assert_right(association, truth):
    """Persons are the true ones under one renaming for the whole recording."""
    found = np.concatenate([a.ravel() for a in association.person_of])
    true = np.concatenate([a.ravel() for a in truth])
    np.testing.assert_array_equal(found >= 0, true >= 0)
    names = {int(t): int(f) for f, t in zip(found, true, strict=True)}
    assert len(set(names.values())) == len(names)
    np.testing.assert_array_equal(found, [names[int(t)] for t in true])


def test_with_the_true_rig_everybody_is_told_apart(long_scene):
    _, cameras = lifted(long_scene.recording)
    association = associate(cameras, true_rig(long_scene), step_s=FRAME_S, floor_px=FLOOR_PX)
    assert association.n_persons == 3
    assert association.slot_s == pytest.approx(SLOT_SAMPLES * FRAME_S)
    assert_right(association, true_person(long_scene, association))


@pytest.mark.parametrize("unknown_in", [(0, 1, 2, 3), (1,)])
def test_where_no_body_can_be_placed_keypoints_tell_everybody_apart(long_scene, unknown_in):
    def without_bodies(track):
        return replace(track, root_cam=np.full_like(track.root_cam, np.nan))

    cameras = [
        replace(camera, tracks=tuple(without_bodies(t) for t in camera.tracks))
        if c in unknown_in
        else camera
        for c, camera in enumerate(lifted(long_scene.recording)[1])
    ]
    association = associate(cameras, true_rig(long_scene), step_s=FRAME_S, floor_px=FLOOR_PX)
    assert association.n_persons == 3
    assert_right(association, true_person(long_scene, association))


@pytest.mark.parametrize("camera", [0, 2])
def test_an_exchange_of_ids_in_one_camera_is_outvoted(long_scene, camera):
    cameras = list(long_scene.recording.cameras)
    cameras[camera] = exchanged(cameras[camera], 0, 1, 2 * SLOT_SAMPLES)
    recording = replace(long_scene.recording, cameras=tuple(cameras))
    association = associate(
        lifted(recording)[1], true_rig(long_scene), step_s=FRAME_S, floor_px=FLOOR_PX
    )
    assert association.n_persons == 3
    assert_right(association, true_person(long_scene, association, (camera, 0, 1, 2)))


def test_a_person_who_is_gone_for_a_while_is_the_same_while_one_track_lives(long_scene):
    def without(camera):
        tracks = list(camera.tracks)
        gone = (tracks[0].frames >= 80) & (tracks[0].frames < 170)
        begin, end = (
            Track(
                track_id,
                *(getattr(tracks[0], n)[rows] for n in ("frames", "keypoints", "joints", "scores")),
            )
            for track_id, rows in (
                (tracks[0].track_id, ~gone & (tracks[0].frames < 80)),
                (90, ~gone & (tracks[0].frames >= 170)),
            )
        )
        return replace(camera, tracks=(begin, *tracks[1:], end))

    cameras = list(long_scene.recording.cameras)
    cameras[1] = without(cameras[1])
    recording = replace(long_scene.recording, cameras=tuple(cameras))
    association = associate(
        lifted(recording)[1], true_rig(long_scene), step_s=FRAME_S, floor_px=FLOOR_PX
    )
    assert association.n_persons == 3
    first, last = association.person_of[1][0], association.person_of[1][-1]
    assert set(first[first >= 0]) == set(last[last >= 0])


@pytest.fixture(scope="module")
def crowd():
    scene = simulate(
        replace(
            EXACT,
            n_frames=200,
            n_people=6,
            sigma_px=3.0,
            missing=0.25,
            occlusions=True,
            id_switches_per_10s=1.0,
            bursts_per_10s=0.5,
            seed=4,
        )
    )
    _, cameras = lifted(scene.recording)
    rig = true_rig(scene)
    return cameras, rig, associate(cameras, rig, step_s=FRAME_S, floor_px=FLOOR_PX)


def test_two_tracks_of_one_camera_are_never_one_person_at_one_time(crowd):
    cameras, rig, association = crowd
    together = 0
    for c, camera in enumerate(cameras):
        for i, j in combinations(range(len(camera.tracks)), 2):
            common = np.intersect1d(camera.tracks[i].frames, camera.tracks[j].frames)
            slots = association.slot(camera.stamps[common] + rig.offset_s[c])
            for s in np.flatnonzero(np.bincount(slots, minlength=1) >= SLOT_SAMPLES // 4):
                one, two = association.person_of[c][[i, j], s]
                assert one != two or one == -1
                together += 1
    assert together > 100


def test_tracks_that_are_not_there_are_nobody(crowd):
    cameras, rig, association = crowd
    for c, camera in enumerate(cameras):
        for p, track in enumerate(camera.tracks):
            slots = association.slot(camera.stamps[track.frames] + rig.offset_s[c])
            away = np.setdiff1d(np.arange(association.person_of[c].shape[1]), slots)
            assert (association.person_of[c][p, away] == -1).all()


def test_groups_do_not_bring_together_what_is_apart():
    # Two are people of one camera; both suit the third.
    for third in range(3):
        one, two = (k for k in range(3) if k != third)
        cost, apart = np.zeros((3, 3)), np.eye(3, dtype=bool)
        cost[third, one] = cost[one, third] = 0.1
        cost[third, two] = cost[two, third] = 0.2
        apart[one, two] = apart[two, one] = True
        known = (cost > 0).astype(float)
        groups = _average_link(cost, known, 8 * known, apart)
        assert sorted(sorted(g) for g in groups) == sorted([sorted([one, third]), [two]])


def test_groups_are_merged_by_mean_cost():
    cost = np.full((4, 4), 1.5)
    cost[0, 1] = cost[1, 0] = cost[2, 3] = cost[3, 2] = 0.2
    groups = _average_link(cost, np.ones((4, 4)), np.full((4, 4), 8.0), np.eye(4, dtype=bool))
    assert sorted(sorted(g) for g in groups) == [[0, 1], [2, 3]]


def test_who_is_seen_together_for_longer_comes_first():
    # A stranger (1) who passes is a little closer to 0 than the person (2) of the same camera.
    cost, shared, apart = np.zeros((3, 3)), np.zeros((3, 3)), np.eye(3, dtype=bool)
    cost[0, 1] = cost[1, 0] = 0.28
    cost[0, 2] = cost[2, 0] = 0.30
    shared[0, 2] = shared[2, 0] = 3.0
    apart[1, 2] = apart[2, 1] = True
    known = (cost > 0).astype(float)
    for n, expected in ((1.0, [[0, 2], [1]]), (3.0, [[0, 1], [2]])):
        shared[0, 1] = shared[1, 0] = n
        groups = _average_link(cost, known, shared, apart)
        assert sorted(sorted(g) for g in groups) == expected


def test_margins_say_how_much_worse_the_next_best_is(exact_scene, exact_lifted):
    _, cameras = exact_lifted
    association = associate(cameras, true_rig(exact_scene), step_s=FRAME_S, floor_px=FLOOR_PX)
    assert set(association.margins) == {0, 1, 2}
    assert min(association.margins.values()) > 100


def test_alone_there_is_nobody_to_be_mistaken_for(exact_scene, exact_lifted):
    _, cameras = exact_lifted
    persons = exact_scene.track_persons
    alone = tuple(
        replace(c, tracks=tuple(t for t in c.tracks if persons[c.name][t.track_id][0] == 1))
        for c in cameras
    )
    association = associate(alone, true_rig(exact_scene), step_s=FRAME_S, floor_px=FLOOR_PX)
    assert association.n_persons == 1
    assert association.margins == {0: float("inf")}


def test_strangers_are_put_together_with_nobody(exact_scene, exact_lifted):
    _, cameras = exact_lifted
    persons = exact_scene.track_persons
    split = tuple(
        replace(
            c,
            tracks=tuple(t for t in c.tracks if persons[c.name][t.track_id][0] == min(k, 2)),
        )
        for k, c in enumerate(cameras)
    )
    association = associate(split, true_rig(exact_scene), step_s=FRAME_S, floor_px=8.0)
    found = [set(p[p >= 0].tolist()) for p in association.person_of]
    assert found[2] == found[3]
    assert not found[0] & found[1]
    assert not (found[0] | found[1]) & found[2]


def test_a_camera_that_saw_nobody_is_no_obstacle(exact_scene, exact_lifted):
    _, cameras = exact_lifted
    blind = (cameras[0], replace(cameras[1], tracks=()), *cameras[2:])
    association = associate(blind, true_rig(exact_scene), step_s=FRAME_S, floor_px=FLOOR_PX)
    assert association.person_of[1].shape[0] == 0
    assert association.n_persons == 3


def test_slots_are_by_the_clock_of_the_reference(exact_scene, exact_lifted):
    _, cameras = exact_lifted
    rig = true_rig(exact_scene)
    plain = associate(cameras, rig, step_s=FRAME_S, floor_px=FLOOR_PX)
    late = (cameras[0], replace(cameras[1], stamps=cameras[1].stamps + 7.0), *cameras[2:])
    offset_s = rig.offset_s.copy()
    offset_s[1] -= 7.0
    shifted = associate(late, replace(rig, offset_s=offset_s), step_s=FRAME_S, floor_px=FLOOR_PX)
    for one, two in zip(plain.person_of, shifted.person_of, strict=True):
        np.testing.assert_array_equal(one, two)


def test_slots_that_are_left_out_hold_nobody_and_the_others_the_same(long_scene):
    _, cameras = lifted(long_scene.recording)
    settings = {"step_s": FRAME_S, "floor_px": FLOOR_PX}
    whole = associate(cameras, true_rig(long_scene), **settings)
    some = associate(cameras, true_rig(long_scene), every=2, **settings)
    for one, other in zip(some.person_of, whole.person_of, strict=True):
        assert one.shape == other.shape
        np.testing.assert_array_equal(one[:, ::2], other[:, ::2])
        assert (one[:, 1::2] == -1).all()
