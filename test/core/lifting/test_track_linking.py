"""Tracks that are made of the places of people alone."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import stcalib_ros as st
from stcalib_ros.core.lifting.track_linking import linked
from stcalib_ros.core.model.recording import Track


def detections(camera):
    """Every pose as a track of its own."""
    rows = [(track, k) for track in camera.tracks for k in range(len(track.frames))]
    order = np.random.default_rng(0).permutation(len(rows))
    tracks = tuple(
        Track(
            number,
            *(
                getattr(rows[i][0], name)[rows[i][1] : rows[i][1] + 1]
                for name in ("frames", "keypoints", "joints", "scores")
            ),
        )
        for number, i in enumerate(order)
    )
    return replace(camera, tracks=tracks)


def owners(camera, made):
    """Of every track that was made, whose poses it has, in their order."""
    by_pose = {
        (int(frame), track.keypoints[k].tobytes()): track.track_id
        for track in camera.tracks
        for k, frame in enumerate(track.frames)
    }
    return [
        [by_pose[int(frame), t.keypoints[k].tobytes()] for k, frame in enumerate(t.frames)]
        for t in made.tracks
    ]


def scene(**options):
    defaults = {"n_cameras": 2, "n_frames": 150, "id_switches_per_10s": 0, "flip_rate": 0}
    return st.simulate(st.SceneOptions(**{**defaults, **options}))


@pytest.mark.parametrize(
    ("options", "n_exchanged"),
    [
        ({}, 0),
        ({"n_people": 6}, 0),
        ({"fps": 5.0}, 0),
        ({"n_people": 5, "occlusions": True}, 0),
        ({"bursts_per_10s": 3.0, "missing": 0.1}, 2),
        ({"n_people": 8, "occlusions": True, "focal_px": 700.0}, 12),
    ],
)
def test_people_keep_their_tracks(options, n_exchanged):
    for camera in scene(**options).recording.cameras:
        made = linked(detections(camera))
        found = owners(camera, made)
        exchanges = sum(a != b for own in found for a, b in pairwise(own))
        assert exchanges <= n_exchanged
        assert len(found) <= 2 * len(camera.tracks)
        assert sum(map(len, found)) == sum(len(track.frames) for track in camera.tracks)
        for track in made.tracks:
            assert (np.diff(track.frames) > 0).all()


def test_whoever_is_gone_for_long_begins_another_track():
    camera = scene(n_people=1).recording.cameras[0]
    (track,) = camera.tracks
    for gap, n_tracks in ((6, 1), (30, 2)):
        kept = (track.frames < 50) | (track.frames >= 50 + gap)
        arrays = (getattr(track, name)[kept] for name in ("keypoints", "joints", "scores"))
        parted = replace(camera, tracks=(Track(0, track.frames[kept], *arrays),))
        assert len(linked(parted).tracks) == n_tracks


def test_nobody_has_no_tracks():
    camera = replace(scene().recording.cameras[0], tracks=())
    assert linked(camera) is camera
