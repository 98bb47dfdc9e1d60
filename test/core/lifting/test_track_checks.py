"""Ids that follow persons, and ids that do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import HALF_SECOND, error, tracks_changed

import stcalib_ros as st
from stcalib_ros.core.lifting.limits import MIN_CONTINUED
from stcalib_ros.core.lifting.track_checks import continued_fraction, with_tracks
from stcalib_ros.core.model.recording import Track
from stcalib_ros.core.model.rejection import RejectionReason, RemarkCode

SCENE = st.simulate(st.SceneOptions(n_cameras=3, n_people=3, n_frames=120, seed=4))


def with_ids(camera, id_of):
    """The poses of a camera under other ids, one by image and place in its list."""
    rows = [
        (int(frame), track, k) for track in camera.tracks for k, frame in enumerate(track.frames)
    ]
    by_id = {}
    places = {}
    for frame, track, k in sorted(rows, key=lambda row: (row[0], row[1].track_id)):
        place = places[frame] = places.get(frame, -1) + 1
        by_id.setdefault(id_of(frame, place), []).append((frame, track, k))
    tracks = tuple(
        Track(
            number,
            np.array([frame for frame, _, _ in own]),
            *(
                np.stack([getattr(track, name)[k] for _, track, k in own])
                for name in ("keypoints", "joints", "scores")
            ),
        )
        for number, own in by_id.items()
    )
    return replace(camera, tracks=tracks)


def shuffled(frame, place):
    return int(np.random.default_rng(frame).permutation(3)[place])


NO_TRACKS = [shuffled, lambda frame, place: 10 * frame + place]


@pytest.mark.parametrize("id_of", NO_TRACKS)
def test_people_whose_ids_are_no_tracks_are_linked(id_of):
    true = SCENE.recording.cameras[1]
    camera = with_ids(true, id_of)
    assert continued_fraction(camera) < MIN_CONTINUED - 0.2
    found = with_tracks(camera)
    (remark,) = found.remarks
    assert found.fault is None
    assert (remark.code, remark.cameras) == (RemarkCode.IDS_LINKED, ("cam1",))
    assert remark.values["n_tracks"] == len(found.camera.tracks)
    assert continued_fraction(found.camera) > MIN_CONTINUED + 0.2


def test_people_who_jump_cannot_be_linked():
    rng = np.random.default_rng(0)

    def scattered(track):
        return replace(track, keypoints=track.keypoints + rng.uniform(-4e3, 4e3, (120, 1, 2)))

    camera = tracks_changed(scattered)(SCENE.recording.cameras[1])
    found = with_tracks(camera)
    assert (found.camera, found.remarks) == (camera, ())
    assert found.fault.reason is RejectionReason.IDS_ARE_NO_TRACKS
    assert found.fault.measured < found.fault.limit == MIN_CONTINUED


@pytest.mark.parametrize("which", [(1,), (0, 1, 2)])
def test_cameras_without_tracks_are_calibrated_and_named(which):
    cameras = tuple(
        with_ids(camera, NO_TRACKS[1]) if k in which else camera
        for k, camera in enumerate(SCENE.recording.cameras)
    )
    found = st.calibrate(replace(SCENE.recording, cameras=cameras), HALF_SECOND)
    assert [camera.name for camera in found.cameras] == ["cam0", "cam1", "cam2"]
    assert found.message.count("track ids do not follow people") == 1
    linked = [one for one in found.remarks if one.code is RemarkCode.IDS_LINKED]
    assert len(linked) == len(which)
    assert error(found, SCENE.truth).E_R < 0.005


@pytest.mark.parametrize("length", [15, 40])
def test_tracks_that_are_lost_now_and_then_are_tracks(length):
    camera = SCENE.recording.cameras[0]
    fragments = with_ids(camera, lambda frame, place: 1000 * (frame // length) + place)
    assert continued_fraction(fragments) > MIN_CONTINUED + 0.1
    for own in SCENE.recording.cameras:
        found = with_tracks(own)
        assert (found.camera, found.remarks, found.fault) == (own, (), None)


def test_of_few_poses_nothing_is_said():
    camera = SCENE.recording.cameras[0]
    few = replace(camera, tracks=(camera.tracks[0],))
    short = replace(few, tracks=(replace_rows(few.tracks[0], 20),))
    assert np.isnan(continued_fraction(short))
    assert with_tracks(short).remarks == ()


def replace_rows(track, n):
    arrays = (getattr(track, name)[:n] for name in ("frames", "keypoints", "joints", "scores"))
    return Track(track.track_id, *arrays)


@pytest.mark.parametrize("every", [6, 15])
def test_few_images_a_second_have_tracks_as_well(every):
    camera = SCENE.recording.cameras[0]

    def thinned(track):
        kept = track.frames % every == 0
        arrays = (getattr(track, name)[kept] for name in ("keypoints", "joints", "scores"))
        return Track(track.track_id, track.frames[kept] // every, *arrays)

    slow = replace(
        camera, stamps=camera.stamps[::every], tracks=tuple(thinned(t) for t in camera.tracks)
    )
    people = tuple(replace(t, track_id=10 * k + t.track_id) for k in range(5) for t in slow.tracks)
    assert continued_fraction(replace(slow, tracks=people)) > MIN_CONTINUED + 0.1
