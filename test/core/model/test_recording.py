"""Parts of recordings in time."""

from dataclasses import replace

import numpy as np
import pytest

from stcalib_ros.core.model.recording import (
    Track,
    excerpt,
    keypoints_only,
    only_images,
    unknown_joints,
)
from stcalib_ros.core.synthetic import SceneOptions, simulate


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


def test_times_of_receipt_stay_with_their_images(small_scene):
    camera = small_scene.recording.cameras[0]
    recorded = replace(camera, received=camera.stamps + 0.02)
    part = excerpt(replace(small_scene.recording, cameras=(recorded,)), 1.0, 2.0).cameras[0]
    np.testing.assert_array_equal(part.received, part.stamps + 0.02)


def known(recording):
    """Whether any 3D pose of a camera is known, by camera."""
    return [any(np.isfinite(t.joints).any() for t in c.tracks) for c in recording.cameras]


def test_keypoints_alone_are_those_of_the_recording(small_scene):
    whole, flat = small_scene.recording, keypoints_only(small_scene.recording)
    assert known(whole) == [True, True, True]
    assert known(flat) == [False, False, False]
    for camera, other in zip(whole.cameras, flat.cameras, strict=True):
        for track, without in zip(camera.tracks, other.tracks, strict=True):
            assert without.keypoints is track.keypoints
            assert without.joints.shape == track.joints.shape
    assert known(excerpt(flat, 0.5, 1.0)) == [False, False, False]


def test_3d_poses_of_some_cameras(small_scene):
    assert known(keypoints_only(small_scene.recording, ["cam0", "cam2"])) == [False, True, False]
    assert known(keypoints_only(small_scene.recording, [])) == [True, True, True]


def test_nothing_is_left_empty(small_scene):
    part = excerpt(small_scene.recording, 50.0, 60.0)
    assert [len(c.stamps) for c in part.cameras] == [0, 0, 0]
    assert not any(c.tracks for c in part.cameras)


def test_some_images_keep_their_stamps_and_people_and_tracks_without_any_go(rng):
    def track(frames):
        n = len(frames)
        x = rng.normal(size=(n, 17, 2))
        return Track(len(frames), np.array(frames), x, unknown_joints(x), np.ones((n, 17)))

    (camera,) = simulate(SceneOptions(n_cameras=1, n_frames=6)).recording.cameras
    camera = replace(
        camera, tracks=(track([0, 1, 2, 4]), track([1, 3])), received=camera.stamps + 0.1
    )
    used = np.array([True, False, True, False, True, True])
    some = only_images(camera, used)
    np.testing.assert_array_equal(some.stamps, camera.stamps[used])
    np.testing.assert_array_equal(some.received, camera.received[used])
    (left,) = some.tracks
    assert left.frames.tolist() == [0, 1, 2]
    np.testing.assert_array_equal(left.keypoints, camera.tracks[0].keypoints[[0, 2, 3]])
