"""Monocular poses put where their keypoints are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import changed, every, lifted, tracks_changed
from hypothesis import given
from hypothesis import strategies as st

from stcalib_ros.core.geometry.alignment import umeyama
from stcalib_ros.core.geometry.so3 import exp_so3, log_so3
from stcalib_ros.core.lifting.lift import crop_fraction, lift
from stcalib_ros.core.synthetic.lifter import crop_rotation

seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def poses(exact_scene):
    """True poses of one person in the optical frame (F, 17, 3), all of them in the image."""
    camera = exact_scene.truth.cameras[1]
    times = np.arange(0, 2.5, 0.1)
    ref = exact_scene.joints_ref(times)[0]
    return (ref - camera.t_ref_cam) @ camera.R_ref_cam


def on_plane(points):
    return points[..., :2] / points[..., 2:]


def turned(poses, vector):
    """Poses turned about their middle and moved to the origin."""
    centred = poses - poses.mean(1, keepdims=True)
    return centred @ exp_so3(np.asarray(vector, float)).T


def angles(poses, true):
    """Angles (rad) by which poses are turned from the true ones."""
    return np.array(
        [np.linalg.norm(log_so3(umeyama(a, b)[1])) for a, b in zip(poses, true, strict=True)]
    )


def test_a_pose_that_fits_is_only_moved(poses):
    np.testing.assert_allclose(lift(poses - poses[:, :1], on_plane(poses)), poses, atol=1e-9)


@given(seeds)
def test_where_the_origin_is_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    pose = rng.uniform([-0.3, -0.7, 3.5], [0.8, 0.3, 4.5], (2, 8, 3))
    moved = lift(pose + rng.uniform(-5, 5, 3), on_plane(pose))
    np.testing.assert_allclose(moved, pose, atol=1e-8)


def test_without_steps_the_root_is_the_closed_form(poses):
    wrong = turned(poses, [0.05, 0.1, 0.0])
    x = on_plane(poses)
    placed = lift(wrong, x, steps=0)
    root = (placed - wrong)[:, 0]
    b = np.concatenate([x, np.ones_like(x[..., :1])], -1)
    b /= np.linalg.norm(b, axis=-1, keepdims=True)

    def cost(T):
        Z = wrong + T[:, None]
        return ((Z - (Z * b).sum(-1, keepdims=True) * b) ** 2).sum((1, 2))

    h = 1e-4
    gradient = np.stack([(cost(root + h * e) - cost(root - h * e)) / (2 * h) for e in np.eye(3)])
    np.testing.assert_allclose(gradient, 0, atol=1e-9)


@pytest.mark.parametrize("axis", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, -0.6, 0.5]])
@pytest.mark.parametrize("degrees", [3, 10])
def test_a_tilt_is_taken_back(poses, axis, degrees):
    vector = np.radians(degrees) * np.array(axis) / np.linalg.norm(axis)
    wrong = turned(poses, vector)
    before, after = angles(wrong, poses), angles(lift(wrong, on_plane(poses)), poses)
    assert np.median(before) == pytest.approx(np.radians(degrees), rel=1e-6)
    # A prior holds part of it back: depth is seen through perspective alone.
    assert np.median(after) < 0.45 * np.radians(degrees)
    assert (after < before).all()


def test_the_rotation_of_a_step_is_bounded(poses):
    wrong = turned(poses, [0.0, 0.0, 1.0])
    once = lift(wrong, on_plane(poses), steps=1)
    np.testing.assert_array_less(angles(once, lift(wrong, on_plane(poses), steps=0)), 0.3 + 1e-9)


def test_a_wild_key_point_hardly_matters(poses):
    x = on_plane(poses).copy()
    x[:, 3] += 0.3
    away = np.linalg.norm(lift(poses, x) - poses, axis=-1)
    far_off = np.linalg.norm(lift(poses, x, steps=0) - poses, axis=-1)
    assert np.median(away) < 0.25 * np.median(far_off)


@given(seeds, st.integers(0, 12))
def test_six_joints_are_needed(seed, n_seen):
    rng = np.random.default_rng(seed)
    pose = rng.uniform([-0.4, -0.5, 3.4], [0.8, 0.7, 4.6], (1, 12, 3))
    x = on_plane(pose)
    x[0, rng.permutation(12)[n_seen:]] = np.nan
    assert np.isfinite(lift(pose, x)).all() == (n_seen >= 6)


def test_unknown_joints_stay_unknown_and_unseen_ones_are_kept(poses):
    joints, x = poses.copy(), on_plane(poses).copy()
    joints[:, 4] = np.nan
    x[:, 7] = np.nan
    out = lift(joints, x)
    assert np.isnan(out[:, 4]).all()
    known = np.arange(17) != 4
    np.testing.assert_allclose(out[:, known], poses[:, known], atol=1e-9)


def test_somebody_behind_the_camera_is_not_lifted(poses):
    # Their images are those of points ahead, but the pose is mirrored in depth and in the image.
    mirrored = -(poses - poses.mean(1, keepdims=True))
    out = lift(mirrored, on_plane(poses), steps=0)
    ahead = np.isfinite(out).all((1, 2))
    assert (out[ahead][..., 2] > 0.3).all()
    assert not ahead.any()


def test_people_at_the_lens_are_not_lifted(poses):
    tiny = 0.01 * poses
    assert np.isnan(lift(tiny, on_plane(poses))).all()


def test_no_frames_give_no_frames():
    assert lift(np.zeros((0, 17, 3)), np.zeros((0, 17, 2))).shape == (0, 17, 3)


# A whole recording


def test_an_exact_recording_is_lifted_to_the_truth(exact_scene, exact_lifted):
    _, cameras = exact_lifted
    for c, camera in enumerate(cameras):
        truth = exact_scene.truth.cameras[c]
        for track in camera.tracks:
            person = exact_scene.track_persons[camera.name][track.track_id][0]
            times = camera.stamps[track.frames]
            ref = exact_scene.joints_ref(times)[person]
            true_cam = (ref - truth.t_ref_cam) @ truth.R_ref_cam
            np.testing.assert_allclose(track.joints_cam, true_cam, atol=1e-6)
            seen = np.isfinite(track.x).all(-1)
            np.testing.assert_allclose(track.x[seen], on_plane(true_cam)[seen], atol=1e-9)


@pytest.mark.parametrize("scale", [0.01, 1.0, 300.0])
def test_poses_up_to_scale_are_given_the_size_of_an_adult(exact_scene, exact_lifted, scale):
    recording = every(
        exact_scene.recording, tracks_changed(lambda t: replace(t, joints=scale * t.joints))
    )
    recording = every(recording, lambda c: replace(c, metric=False))
    _, metric = exact_lifted
    skeleton, cameras = lifted(recording)
    for camera, before in zip(cameras, metric, strict=True):
        for track, true in zip(camera.tracks, before.tracks, strict=True):
            known = np.isfinite(skeleton.adult_lengths)
            bones = np.einsum("dj,fjk->fdk", skeleton.directions[known], track.joints_cam)
            total = np.nanmedian(np.linalg.norm(bones, axis=-1), axis=0).sum()
            assert total == pytest.approx(skeleton.adult_lengths[known].sum(), rel=1e-6)
            ratio = track.joints_cam / true.joints_cam
            np.testing.assert_allclose(ratio, np.median(ratio), rtol=1e-6)


def test_joints_of_a_low_score_are_not_used(exact_scene):
    def doubtful(track):
        scores = track.scores.copy()
        scores[:, 2] = 0.29
        return replace(track, scores=scores)

    _, cameras = lifted(changed(exact_scene.recording, "cam1", tracks_changed(doubtful)))
    for camera in cameras:
        for track in camera.tracks:
            assert np.isnan(track.x[:, 2]).all() == (camera.name == "cam1")


def test_tracks_of_nothing_are_left_out(exact_scene):
    def unseen(track):
        return replace(track, keypoints=np.full_like(track.keypoints, np.nan))

    _, cameras = lifted(changed(exact_scene.recording, "cam1", tracks_changed(unseen)))
    assert [len(c.tracks) > 0 for c in cameras] == [True, False, True, True]
    assert len(cameras[1].stamps) == len(exact_scene.recording.cameras[1].stamps)


def off_axis(poses, degrees):
    """The same people in the middle of the image, then turned out of it."""
    middle = crop_rotation(poses.mean((0, 1))[None], 1.0).as_matrix()[0]
    return poses @ middle.T @ exp_so3(np.radians(degrees) * np.array([-0.6, 0.8, 0.0])).T


def as_if_straight_ahead(poses, share):
    """What a lifter makes of crops of the image."""
    R = crop_rotation(poses[:, 0], share).as_matrix()
    return np.einsum("fab,fjb->fja", R, poses - poses[:, :1])


@pytest.mark.parametrize("degrees", [20, 30, 45])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_the_share_of_the_crop_is_found_and_taken_back(poses, rng, degrees, share):
    true = off_axis(poses, degrees)
    wrong = as_if_straight_ahead(true, share)
    wrong += 0.02 * rng.normal(size=wrong.shape)
    x = on_plane(true) + 0.002 * rng.normal(size=(*wrong.shape[:2], 2))
    assert crop_fraction([(wrong[:12], x[:12]), (wrong[12:], x[12:])]) == share
    after = np.median(angles(lift(wrong, x, crop=share), true))
    assert after < np.radians(3)
    if share * degrees >= 30:
        assert np.median(angles(lift(wrong, x), true)) > 1.5 * after


def test_without_people_nothing_is_turned():
    none = np.full((4, 17, 3), np.nan)
    assert crop_fraction([]) == crop_fraction([(none, none[..., :2])]) == 0.0


def test_each_camera_has_a_share_of_its_own(exact_scene, exact_lifted):
    _, true = exact_lifted
    poses = {track.track_id: track.joints_cam for track in true[1].tracks}

    def of_crops(track):
        return replace(track, joints=as_if_straight_ahead(poses[track.track_id], 1.0))

    _, cameras = lifted(changed(exact_scene.recording, "cam1", tracks_changed(of_crops)))
    for camera, before in zip(cameras, true, strict=True):
        for track, exact in zip(camera.tracks, before.tracks, strict=True):
            off = angles(track.joints_cam, exact.joints_cam)
            assert np.median(off) < (np.radians(1) if camera.name == "cam1" else 1e-6)
