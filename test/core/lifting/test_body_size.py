"""Where a person is, by the usual size of an adult."""

import numpy as np
import pytest

import stcalib_ros as st
from stcalib_ros.core.lifting.body_size import root_by_size
from stcalib_ros.core.lifting.lift import lift_recording
from stcalib_ros.core.model.recording import keypoints_only
from stcalib_ros.core.model.skeleton import common_skeleton

SCENE = st.simulate(st.SceneOptions(n_cameras=3, n_people=2, n_frames=90, seed=3))
SKELETON = common_skeleton(SCENE.recording)


def lifted(recording):
    return lift_recording(recording, SKELETON, min_score=0.3)


def test_bodies_stand_about_where_their_3d_poses_do():
    pairs = [
        (with_3d.root_cam, without.root_cam)
        for a, b in zip(
            lifted(SCENE.recording), lifted(keypoints_only(SCENE.recording)), strict=True
        )
        for with_3d, without in zip(a.tracks, b.tracks, strict=True)
    ]
    a, b = (np.concatenate(side) for side in zip(*pairs, strict=True))
    ratio = a[:, 2] / b[:, 2]
    assert np.median(ratio) == pytest.approx(1.0, abs=0.1)
    assert np.percentile(np.abs(np.log(ratio)), 90) < 0.25


def test_tracks_without_3d_keep_their_keypoints():
    camera = lifted(keypoints_only(SCENE.recording))[0]
    assert camera.tracks
    assert all(np.isnan(track.joints_cam).all() for track in camera.tracks)
    assert all(np.isfinite(track.x).any() for track in camera.tracks)


def test_a_limb_of_known_length_gives_the_depth():
    x = np.full((1, SKELETON.layout.n_joints, 2), np.nan)
    x[0, SKELETON.layout.index("left_knee")] = 0.0, 0.0
    x[0, SKELETON.layout.index("left_ankle")] = 0.0, 0.42 / 5.0
    np.testing.assert_allclose(root_by_size(x, SKELETON), [[0.0, 0.042 * 5.0, 5.0]])


def test_without_a_limb_there_is_no_depth():
    x = np.full((1, SKELETON.layout.n_joints, 2), np.nan)
    x[0, 0] = 0.0
    assert np.isnan(root_by_size(x, SKELETON)).all()
