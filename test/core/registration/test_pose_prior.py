"""What 3D poses say about a pair: exact poses, independent errors, errors that stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import EXACT, lifted, true_rig
from epipolar_helpers import direction_error, true_pair

from stcalib_ros.core.geometry.so3 import exp_so3, rotation_angle
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import keypoints_only
from stcalib_ros.core.model.relative_pose import relative_pose
from stcalib_ros.core.options import Options
from stcalib_ros.core.registration.pairs import pair_tasks, register
from stcalib_ros.core.registration.pose_prior import PosePrior, pose_prior
from stcalib_ros.core.registration.resampling import Grid, common_step
from stcalib_ros.core.registration.two_view_refinement import refine_pair
from stcalib_ros.core.synthetic import SceneOptions, paper_scene, simulate


@pytest.fixture(scope="module")
def exact():
    """Exact cameras without clock offset, and the true relation of the first two."""
    scene = simulate(replace(EXACT, max_offset_frames=0, seed=5, n_frames=120))
    return lifted(scene.recording)[1], true_pair(scene, 0, 1)


def with_poses(camera: LiftedCamera, change) -> LiftedCamera:
    """The same keypoints with other 3D poses."""
    tracks = (replace(t, joints_cam=change(t.joints_cam)) for t in camera.tracks)
    return replace(camera, tracks=tuple(tracks))


def projecting(camera: LiftedCamera, rng: np.random.Generator, sigma_m: float) -> LiftedCamera:
    """Poses with errors of each frame that keypoints share."""

    def noisy(track):
        joints = track.joints_cam + sigma_m * rng.normal(size=track.joints_cam.shape)
        return replace(track, joints_cam=joints, x=joints[..., :2] / joints[..., 2:])

    return replace(camera, tracks=tuple(noisy(t) for t in camera.tracks))


def turned_bodies(turn: np.ndarray):
    """Rotate bodies about their middles."""

    def change(joints):
        middle = np.nanmean(joints, axis=1, keepdims=True)
        return middle + (joints - middle) @ turn.T

    return change


def test_exact_poses_are_the_truth(exact):
    cameras, truth = exact
    prior = pose_prior(cameras, truth)
    assert rotation_angle(prior.R_a_b.T @ truth.R_a_b) < 1e-4
    assert direction_error(prior.unit_t, truth.t_a_b) < 1e-4
    assert prior.rotation_stddev < 1e-3
    assert prior.direction_stddev < 2e-3


def test_the_start_does_not_move_the_prior(exact):
    cameras, truth = exact
    start = replace(truth, R_a_b=exp_so3(np.array([0.0, 0.02, 0.0])) @ truth.R_a_b)
    assert np.array_equal(pose_prior(cameras, start).R_a_b, pose_prior(cameras, truth).R_a_b)


def test_independent_errors_count_by_how_little_is_left_of_them(exact, rng):
    cameras, truth = exact
    few, many = (
        pose_prior([projecting(c, rng, s) for c in cameras[:2]], truth).rotation_stddev
        for s in (0.01, 0.04)
    )
    # 24 blocks tell a standard deviation to some 15 %.
    assert many / few == pytest.approx(4, rel=0.4)
    assert many < 0.02


def test_errors_of_the_prior_are_as_large_as_it_says(exact):
    cameras, truth = exact
    errors, stddevs = [], []
    for seed in range(12):
        own = np.random.default_rng(seed)
        prior = pose_prior([projecting(c, own, 0.03) for c in cameras[:2]], truth)
        errors.append(float(rotation_angle(prior.R_a_b.T @ truth.R_a_b)))
        stddevs.append(prior.rotation_stddev)
    rms = float(np.sqrt(np.mean(np.square(errors))))
    # Independent errors are half of what it says: it allows for slow ones, too.
    assert np.mean(stddevs) / rms == pytest.approx(2.0, rel=0.5)


def test_poses_turned_off_their_keypoints_are_doubted_though_they_all_agree(exact):
    (cam_a, cam_b, *_), truth = exact
    turn = exp_so3(np.array([0.0, 0.0, 0.025]))
    prior = pose_prior([with_poses(cam_a, turned_bodies(turn)), cam_b], truth)
    assert rotation_angle(prior.R_a_b.T @ truth.R_a_b) == pytest.approx(0.025, rel=0.05)
    assert 0.003 < prior.rotation_stddev < 0.025


def test_poses_that_contradict_the_keypoints_are_not_used(exact):
    cameras, truth = exact
    for angle, used in ((0.08, True), (0.12, False)):
        start = replace(truth, R_a_b=exp_so3(np.array([angle, 0.0, 0.0])) @ truth.R_a_b)
        assert (pose_prior(cameras, start) is not None) == used


def test_poses_that_know_no_rotation_are_not_used(exact, rng):
    (cam_a, cam_b, *_), truth = exact

    def noisy(joints):
        return joints + rng.normal(size=joints.shape)

    assert pose_prior([with_poses(cam_a, noisy), cam_b], truth) is None


def test_one_moment_is_no_evidence(exact):
    (cam_a, cam_b, *_), truth = exact
    one = replace(cam_a, tracks=tuple(track[:1] for track in cam_a.tracks))
    assert pose_prior([one, cam_b], replace(truth, matches=truth.matches[:1])) is None


def test_without_3d_in_one_camera_there_is_no_prior(exact):
    (cam_a, cam_b, *_), truth = exact
    flat = with_poses(cam_b, lambda joints: np.full_like(joints, np.nan))
    assert pose_prior([cam_a, flat], truth) is None


def test_one_person_with_3d_is_enough(exact):
    (cam_a, cam_b, *_), truth = exact
    first, *others = cam_a.tracks
    unknown = (replace(t, joints_cam=np.full_like(t.joints_cam, np.nan)) for t in others)
    prior = pose_prior([replace(cam_a, tracks=(first, *unknown)), cam_b], truth)
    assert rotation_angle(prior.R_a_b.T @ truth.R_a_b) < 1e-4


def test_a_prior_that_is_certain_decides_the_refinement(exact):
    cameras, truth = exact
    off = exp_so3(np.array([0.0, 0.02, 0.0]))
    certain = PosePrior(off @ truth.R_a_b, truth.t_a_b / np.linalg.norm(truth.t_a_b), 1e-7, 1e-7)
    refined = refine_pair(cameras, truth, prior=certain)
    assert rotation_angle(refined.R_a_b.T @ certain.R_a_b) < 1e-5
    assert direction_error(refined.t_a_b, truth.t_a_b) < 1e-5


def test_a_prior_that_knows_nothing_changes_nothing(exact):
    cameras, truth = exact
    off = exp_so3(np.array([0.0, 0.02, 0.0]))
    vague = PosePrior(off @ truth.R_a_b, truth.t_a_b / np.linalg.norm(truth.t_a_b), 1e3, 1e3)
    with_it, without = refine_pair(cameras, truth, prior=vague), refine_pair(cameras, truth)
    assert rotation_angle(with_it.R_a_b.T @ without.R_a_b) < 1e-6
    assert direction_error(with_it.t_a_b, without.t_a_b) < 1e-6


def pair_errors(scene, recording) -> list[float]:
    """Errors (rad) of the rotations of all pairs of a scene, as they are registered."""
    skeleton, cameras = lifted(recording)
    step = common_step(cameras)
    grid = Grid(float(cameras[0].stamps[0]), step, len(cameras[0].stamps))
    options = Options(offset_range_s=0.0)
    found = [
        register(t)[0] for t in pair_tasks(cameras, [0, 1, 2, 3], skeleton, options, grid=grid)
    ]
    rig = true_rig(scene)
    truth = [relative_pose(rig, h.a, h.b) for h in found]
    return [float(rotation_angle(h.R_a_b.T @ t.R_a_b)) for h, t in zip(found, truth, strict=True)]


def test_pairs_with_good_3d_poses_are_better_than_by_keypoints_alone():
    scene = paper_scene(SceneOptions(n_frames=60, sigma_px=3.0, seed=5), offset_frames=0.0)
    fused = pair_errors(scene, scene.recording)
    flat = pair_errors(scene, keypoints_only(scene.recording))
    assert np.mean(fused) < 0.5 * np.mean(flat)


def test_pairs_with_poor_3d_poses_are_no_worse_than_by_keypoints_alone():
    fused, flat = [], []
    for seed in (4, 5, 6):
        scene = simulate(SceneOptions(n_frames=90, sigma_px=3.0, seed=seed, max_offset_frames=0))
        fused += pair_errors(scene, scene.recording)
        flat += pair_errors(scene, keypoints_only(scene.recording))
    assert np.mean(fused) < 1.1 * np.mean(flat)
