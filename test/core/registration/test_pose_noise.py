"""How far a registration may be off: exact poses, independent errors, errors that stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import EXACT, lifted, true_rig

from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.registration.pose_noise import registration_stddev
from stcalib_ros.core.synthetic import simulate


@pytest.fixture(scope="module")
def exact():
    """Two exact cameras without clock offset, and the true relation of them."""
    scene = simulate(replace(EXACT, max_offset_frames=0, seed=5, n_frames=120))
    rig = true_rig(scene)
    persons = [
        {int(own[0]): i for i, own in enumerate(scene.track_persons[c.name].values())}
        for c in scene.recording.cameras
    ]
    matches = tuple((persons[0][p], persons[1][p]) for p in persons[0] if p in persons[1])
    truth = RelativePose(0, 1, rig.R_ref_cam[1], rig.t_ref_cam[1], 0.0, matches, 1.0)
    return lifted(scene.recording)[1][:2], truth


def changed(camera, change):
    """The same camera with other 3D poses and the same keypoints."""
    tracks = tuple(replace(t, joints_cam=change(t.joints_cam)) for t in camera.tracks)
    return LiftedCamera(camera.name, camera.stamps, tracks)


def projecting(camera, rng, sigma):
    """Poses with errors of each frame that keypoints share."""

    def noisy(track):
        joints = track.joints_cam + sigma * rng.normal(size=track.joints_cam.shape)
        return replace(track, joints_cam=joints, x=joints[..., :2] / joints[..., 2:])

    return replace(camera, tracks=tuple(noisy(t) for t in camera.tracks))


def test_exact_poses_leave_no_doubt(exact):
    (cam_a, cam_b), truth = exact
    rotation, direction = registration_stddev(cam_a, cam_b, truth)
    assert rotation < 1e-3
    assert direction < 2e-3


def test_independent_errors_count_by_how_little_is_left_of_them(exact, rng):
    (cam_a, cam_b), truth = exact
    few, many = (
        registration_stddev(projecting(cam_a, rng, s), projecting(cam_b, rng, s), truth)[0]
        for s in (0.01, 0.04)
    )
    # 24 blocks tell a deviation to some 15 %.
    assert many / few == pytest.approx(4, rel=0.4)
    assert many < 0.02


def test_poses_turned_off_their_key_points_are_doubted_though_they_all_agree(exact):
    (cam_a, cam_b), truth = exact
    turn = exp_so3(np.array([0.0, 0.0, 0.08]))

    def turned(joints):
        middle = np.nanmean(joints, axis=1, keepdims=True)
        return middle + (joints - middle) @ turn.T

    wrong = replace(truth, R_a_b=turn @ truth.R_a_b)
    rotation, _ = registration_stddev(changed(cam_a, turned), cam_b, wrong)
    assert 0.01 < rotation < 0.08


def test_doubt_has_a_limit_and_one_moment_is_no_evidence(exact, rng):
    (cam_a, cam_b), truth = exact

    def noisy(joints):
        return joints + rng.normal(size=joints.shape)

    limit, _ = registration_stddev(changed(cam_a, noisy), cam_b, truth)
    one = tuple(track[:1] for track in cam_a.tracks)
    single = replace(truth, matches=truth.matches[:1])
    assert registration_stddev(replace(cam_a, tracks=one), cam_b, single)[0] == limit
