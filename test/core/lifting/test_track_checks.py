"""Ids that follow persons, and ids that do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import stcalib_ros as st
from stcalib_ros.core.lifting.limits import MIN_CONTINUED
from stcalib_ros.core.lifting.track_checks import continued_fraction, track_faults
from stcalib_ros.core.model.recording import Track
from stcalib_ros.core.model.rejection import RejectionReason

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


@pytest.mark.parametrize("id_of", [shuffled, lambda frame, place: 10 * frame + place])
def test_ids_by_place_or_by_detection_are_no_tracks(id_of):
    camera = with_ids(SCENE.recording.cameras[1], id_of)
    assert continued_fraction(camera) < MIN_CONTINUED - 0.2
    cameras = (SCENE.recording.cameras[0], camera, SCENE.recording.cameras[2])
    faults = track_faults(replace(SCENE.recording, cameras=cameras))
    assert {name: fault.reason for name, fault in faults.items()} == {
        "cam1": RejectionReason.IDS_ARE_NO_TRACKS
    }


def test_the_camera_is_left_out_and_named():
    camera = with_ids(SCENE.recording.cameras[1], shuffled)
    cameras = (SCENE.recording.cameras[0], camera, SCENE.recording.cameras[2])
    found = st.calibrate(replace(SCENE.recording, cameras=cameras), st.Options(offset_range_s=0.5))
    assert [camera.name for camera in found.cameras] == ["cam0", "cam2"]
    assert "cam1: its track ids are no tracks" in found.message


@pytest.mark.parametrize("length", [15, 40])
def test_tracks_that_are_lost_now_and_then_are_tracks(length):
    camera = SCENE.recording.cameras[0]
    fragments = with_ids(camera, lambda frame, place: 1000 * (frame // length) + place)
    assert continued_fraction(fragments) > MIN_CONTINUED + 0.1
    assert not track_faults(SCENE.recording)


def test_of_few_poses_nothing_is_said():
    camera = SCENE.recording.cameras[0]
    few = replace(camera, tracks=(camera.tracks[0],))
    short = replace(few, tracks=(replace_rows(few.tracks[0], 20),))
    assert np.isnan(continued_fraction(short))
    assert not track_faults(replace(SCENE.recording, cameras=(short,)))


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
