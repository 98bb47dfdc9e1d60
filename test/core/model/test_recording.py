"""Parts of recordings in time."""

import numpy as np
import pytest

from stcalib_ros.core.model.recording import excerpt


def test_two_halves_are_the_whole(small_scene):
    whole = small_scene.recording
    parts = [excerpt(whole, 0.0, 1.0), excerpt(whole, 1.0, 100.0)]
    for c, camera in enumerate(whole.cameras):
        own = [part.cameras[c] for part in parts]
        np.testing.assert_array_equal(np.concatenate([o.stamps for o in own]), camera.stamps)
        for track in camera.tracks:
            rows = [t for o in own for t in o.tracks if t.track_id == track.track_id]
            points = np.concatenate([t.keypoints for t in rows])
            np.testing.assert_array_equal(points, track.keypoints)
            stamps = [o.stamps[t.frames] for o in own for t in o.tracks if t in rows]
            np.testing.assert_array_equal(np.concatenate(stamps), camera.stamps[track.frames])


def test_offsets_move_the_borders(small_scene):
    part = excerpt(small_scene.recording, 1.0, 2.0, offsets_s={"cam1": 0.5})
    assert part.cameras[0].stamps[0] == pytest.approx(1.0)
    assert part.cameras[1].stamps[0] == pytest.approx(0.5)


def test_nothing_is_left_empty(small_scene):
    part = excerpt(small_scene.recording, 50.0, 60.0)
    assert [len(c.stamps) for c in part.cameras] == [0, 0, 0]
    assert not any(c.tracks for c in part.cameras)
