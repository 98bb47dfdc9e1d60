"""Persons of one image with one track id: of trackers now and then, without a tracker always."""

from __future__ import annotations

import numpy as np
import pytest
from plain import STEP_S, info, poses

from stcalib_ros.io.assemble import CameraImages, assemble_recording
from stcalib_ros.io.messages import camera_info_fields, pose_image

N = 40


def assembled(ids):
    """Tracks and warnings of three persons under such ids, the later ones with higher scores."""
    images = []
    for k in range(N):
        message = poses(100.0 + k * STEP_S, persons=3)
        for n, (person, own) in enumerate(zip(message.persons, ids(k), strict=True)):
            person.track_id, person.score = own, 0.5 + 0.1 * n
            person.keypoints = np.asarray(person.keypoints) + 100.0 * n
        images.append(pose_image(message, topic="/poses"))
    camera = CameraImages("cam0", images, camera_info_fields(info()), "/poses", "/info")
    warnings = []
    recording = assemble_recording([camera], warn=warnings.append)
    return recording.cameras[0].tracks, warnings


@pytest.mark.parametrize("ids", [lambda _: (0, 0, 0), lambda k: (k, 7, 7)])
def test_ids_that_nobody_tracks_are_not_used(ids):
    tracks, (warning,) = assembled(ids)
    assert len({track.track_id for track in tracks}) == len(tracks) == 3 * N
    assert "in 40 of 40 images with several people, some share a track id" in warning


def test_of_ids_that_repeat_now_and_then_the_higher_score_is_kept():
    tracks, (warning,) = assembled(lambda k: (1, 2, 2) if k < 5 else (1, 2, 3))
    assert [len(track.frames) for track in tracks] == [N, N, N - 5]
    assert "5 times, two people of one image have the same track id" in warning
    second = tracks[1].keypoints[:, 0, 0]
    assert second[4] - second[5] == 100.0


def test_ids_that_are_tracks_are_taken_as_they_are():
    tracks, warnings = assembled(lambda _: (5, 6, 9))
    assert [track.track_id for track in tracks] == [5, 6, 9]
    assert not warnings
