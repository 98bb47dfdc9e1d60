"""Tracks are cut where they jump, and left and right put right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import EXACT, FRAME_S, lifted
from epipolar_helpers import camera_of, track_of

from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.core.model.lifted import LiftedTrack
from stcalib_ros.core.model.skeleton import mirrored_joints
from stcalib_ros.core.registration.limits import MAX_GAP_S, MAX_PIECE_FRAMES, MAX_PIECES
from stcalib_ros.core.registration.pieces import (
    Pieces,
    TrackPart,
    cut_tracks,
    longest,
    whole_tracks,
)
from stcalib_ros.core.synthetic import simulate


@pytest.fixture(scope="module")
def scene():
    skeleton, cameras = lifted(simulate(replace(EXACT, seed=1)).recording)
    return skeleton.layout, cameras


def exchanged(camera, i, j, frame):
    """The tracker exchanges two tracks from an image on."""

    def joined(first, second):
        arrays = (
            np.concatenate([getattr(t, name)[rows] for t, rows in parts(first, second)])
            for name in ("frames", "x", "focal", "joints_cam", "root_cam")
        )
        return LiftedTrack(first.track_id, *arrays)

    def parts(first, second):
        return (first, first.frames < frame), (second, second.frames >= frame)

    tracks = list(camera.tracks)
    tracks[i], tracks[j] = joined(tracks[i], tracks[j]), joined(tracks[j], tracks[i])
    return replace(camera, tracks=tuple(tracks))


def tracks_of(pieces):
    """The track of the first part of every piece."""
    return [parts[0].track for parts in pieces.parts]


def spans(pieces):
    """Track, first and last frame of the parts of all pieces."""
    stamps = pieces.camera.stamps
    return sorted(
        (part.track, *np.searchsorted(stamps, [part.begin_s, part.end_s]).tolist())
        for parts in pieces.parts
        for part in parts
    )


def changed(camera, change):
    return replace(camera, tracks=tuple(change(track) for track in camera.tracks))


# Cuts


@pytest.mark.parametrize("camera", range(4))
def test_a_track_is_cut_where_its_id_goes_to_somebody_else(scene, camera):
    layout, cameras = scene
    pieces = cut_tracks(exchanged(cameras[camera], 0, 2, 40), layout)
    assert spans(pieces) == [(0, 0, 39), (0, 40, 79), (1, 0, 79), (2, 0, 39), (2, 40, 79)]


@pytest.mark.parametrize("pace", [1, 2, 4])
def test_nobody_is_cut_for_walking_fast(scene, pace):
    """Every n-th image as if it were the next: somebody who is so many times as fast."""
    layout, cameras = scene

    def faster(track):
        arrays = (one[::pace] for one in (track.x, track.focal, track.joints_cam, track.root_cam))
        return LiftedTrack(track.track_id, track.frames[: -(-len(track.x) // pace)], *arrays)

    for camera in cameras:
        assert [p for p, *_ in spans(cut_tracks(changed(camera, faster), layout))] == [0, 1, 2]


@pytest.mark.parametrize("sigma_px", [0.0, 3.0, 10.0])
def test_nobody_is_cut_for_noise(scene, rng, sigma_px):
    layout, cameras = scene

    def noisy(track):
        noise = sigma_px * rng.normal(size=track.x.shape)
        return replace(track, x=track.x + noise / track.focal[..., None])

    for camera in cameras:
        pieces = cut_tracks(changed(camera, noisy), layout)
        assert [(first, last) for _, first, last in spans(pieces)] == [(0, 79)] * 3


def test_an_exchange_is_found_in_noise(scene, rng):
    layout, cameras = scene

    def noisy(track):
        noise = 5.0 * rng.normal(size=track.x.shape)
        return replace(track, x=track.x + noise / track.focal[..., None])

    pieces = cut_tracks(changed(exchanged(cameras[0], 0, 2, 40), noisy), layout)
    assert spans(pieces) == [(0, 0, 39), (0, 40, 79), (1, 0, 79), (2, 0, 39), (2, 40, 79)]


@pytest.mark.parametrize(("lost", "cut"), [(5, False), (13, False), (16, True), (30, True)])
def test_a_track_that_was_lost_for_half_a_second_may_be_somebody_else(scene, lost, cut):
    layout, cameras = scene

    def standing_with_gap(track):
        still = replace(track, x=np.repeat(track.x[:1], len(track.x), 0))
        return still[(track.frames < 30) | (track.frames >= 30 + lost)]

    pieces = cut_tracks(changed(cameras[1], standing_with_gap), layout)
    assert len(pieces.camera.tracks) == (6 if cut else 3)
    assert ((lost + 1) * FRAME_S > MAX_GAP_S) == cut


@pytest.mark.parametrize("camera", range(4))
def test_nobody_is_cut_for_an_image_that_was_lost(scene, camera):
    layout, cameras = scene
    without = changed(cameras[camera], lambda track: track[track.frames != 33])
    assert [p for p, *_ in spans(cut_tracks(without, layout))] == [0, 1, 2]


def test_pieces_of_few_frames_are_left_out(scene):
    layout, cameras = scene
    shorter = changed(cameras[0], lambda track: track[:9])
    assert not cut_tracks(shorter, layout).camera.tracks
    # And so is a camera that observed nobody.
    assert not cut_tracks(replace(cameras[0], tracks=()), layout).camera.tracks


def test_without_jumps_all_stays_as_it_is(scene):
    layout, cameras = scene
    pieces = cut_tracks(cameras[0], layout)
    for piece, track in zip(pieces.camera.tracks, cameras[0].tracks, strict=True):
        np.testing.assert_array_equal(piece.x, track.x)
    assert tracks_of(pieces) == tracks_of(whole_tracks(cameras[0])) == [0, 1, 2]


# One person under several ids


def test_who_goes_on_under_another_id_is_one_piece(scene):
    layout, cameras = scene
    pieces = cut_tracks(exchanged(cameras[0], 0, 2, 40), layout)
    assert sorted(tuple(part.track for part in parts) for parts in pieces.parts) == [
        (0, 2),
        (1,),
        (2, 0),
    ]
    for piece, parts in zip(pieces.camera.tracks, pieces.parts, strict=True):
        np.testing.assert_array_equal(piece.x, cameras[0].tracks[parts[0].track].x)


@pytest.mark.parametrize(("lost", "linked"), [(0, True), (3, True), (8, False)])
def test_fragments_are_linked_over_short_gaps(scene, lost, linked):
    layout, cameras = scene

    def fragments(track):
        return [track[k : k + 15 - lost] for k in range(0, len(track.frames), 15)]

    tracks = tuple(part for track in cameras[0].tracks for part in fragments(track))
    pieces = cut_tracks(replace(cameras[0], tracks=tracks), layout)
    assert (len(pieces.camera.tracks) == 3) == linked


def test_strangers_are_not_linked(scene):
    layout, cameras = scene
    one, other, _ = cameras[0].tracks
    apart = replace(cameras[0], tracks=(one[:40], other[40:]))
    assert [len(parts) for parts in cut_tracks(apart, layout).parts] == [1, 1]


def test_joints_that_are_missing_for_a_moment_are_filled_in(scene):
    layout, cameras = scene
    track = cameras[0].tracks[0]
    x = track.x.copy()
    x[::2, 3] = np.nan
    x[30:50, 5] = np.nan
    (piece,) = cut_tracks(replace(cameras[0], tracks=(replace(track, x=x),)), layout).camera.tracks
    gaps = np.linalg.norm((piece.x - track.x) * track.focal[..., None], axis=-1)
    assert np.nanmax(gaps[:, 3]) < 3.0
    assert np.isfinite(gaps[:, 3]).sum() > 0.9 * np.isfinite(track.x[:, 3, 0]).sum()
    assert np.isnan(gaps[30:50, 5]).all()


# Left and right


def flipped(camera, frames, mirrored):
    def change(track):
        x = track.x.copy()
        x[frames] = x[frames][:, mirrored]
        return replace(track, x=x)

    return changed(camera, change)


@pytest.mark.parametrize("name", sorted(LAYOUTS))
def test_every_joint_has_the_other_side_of_its_name(name):
    layout = LAYOUTS[name]
    mirrored = mirrored_joints(layout)
    np.testing.assert_array_equal(mirrored[mirrored], np.arange(len(mirrored)))
    for j, other in enumerate(mirrored):
        names = layout.joint_names[j], layout.joint_names[other]
        assert (j == other) == ("left" not in names[0] and "right" not in names[0])
        assert names[0].replace("left", "right") == names[1].replace("left", "right")


@pytest.mark.parametrize("begin", [20, 50])
@pytest.mark.parametrize("length", [1, 6, 15])
def test_a_short_exchange_of_left_and_right_is_undone(scene, begin, length):
    layout, cameras = scene
    wrong = flipped(cameras[0], slice(begin, begin + length), mirrored_joints(layout))
    pieces = cut_tracks(wrong, layout)
    undone = [
        np.allclose(piece.x, track.x, equal_nan=True)
        for piece, track in zip(pieces.camera.tracks, cameras[0].tracks, strict=True)
    ]
    # Of somebody seen from the side left is too near to right for it to be noticed.
    width = [sides_apart_px(track, mirrored_joints(layout)) for track in cameras[0].tracks]
    wide = [track_width[[begin - 1, begin + length]].min() > 40 for track_width in width]
    assert any(wide)
    assert [one or not w for one, w in zip(undone, wide, strict=True)] == [True] * 3


def sides_apart_px(track, mirrored):
    """Mean distance (F,) of the joints from those of the other side, px."""
    sided = mirrored != np.arange(len(mirrored))
    apart = (track.x - track.x[:, mirrored]) * track.focal[..., None]
    return np.nanmean(np.linalg.norm(apart, axis=-1)[:, sided], axis=1)


def test_of_a_long_exchange_nobody_knows_which_side_is_right(scene):
    """The track is cut at both ends, and its keypoints stay as they are."""
    layout, cameras = scene
    wrong = flipped(cameras[0], slice(20, 60), mirrored_joints(layout))
    pieces = cut_tracks(wrong, layout)
    assert (0, 20, 59) in spans(pieces)
    for p, track in enumerate(wrong.tracks):
        own = [c.x for c, q in zip(pieces.camera.tracks, tracks_of(pieces), strict=True) if q == p]
        np.testing.assert_array_equal(np.concatenate(own), track.x)


# The longest


def pieces_of(lengths):
    """Pieces that take no memory, of the tracks 100, 101, ..."""
    tracks = [
        track_of(np.broadcast_to(np.zeros((1, 1, 2)), (n, 1, 2)), track_id=k)
        for k, n in enumerate(lengths)
    ]
    return Pieces(
        camera_of(tracks), tuple((TrackPart(100 + k, 0.0, 0.0),) for k in range(len(lengths)))
    )


def test_the_longest_pieces_are_kept_in_their_order():
    rng = np.random.default_rng(0)
    lengths = rng.permutation(100) + 10
    kept = longest(pieces_of(lengths))
    assert len(kept.camera.tracks) == MAX_PIECES
    expected = np.sort(np.argsort(-lengths)[:MAX_PIECES])
    assert [track.track_id for track in kept.camera.tracks] == expected.tolist()
    assert tracks_of(kept) == (100 + expected).tolist()


def test_pieces_times_the_longest_are_bounded_but_one_is_kept():
    n = MAX_PIECE_FRAMES // 4
    assert tracks_of(longest(pieces_of([10, n, 20, n, 30, 40]))) == [101, 103, 104, 105]
    assert tracks_of(longest(pieces_of([10, 4 * n + 1]))) == [101]
    assert tracks_of(longest(pieces_of([]))) == []


def test_stamps_of_pieces_are_those_of_the_camera(scene):
    layout, cameras = scene
    camera = exchanged(cameras[0], 0, 2, 40)
    kept = longest(cut_tracks(camera, layout))
    np.testing.assert_array_equal(kept.camera.stamps, camera.stamps)
