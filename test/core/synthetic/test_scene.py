"""Simulated scenes: cameras, clocks, tracks and the truth about them."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.evaluation.metrics import evaluate
from stcalib_ros.core.geometry.visibility import project_visible
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.core.synthetic import SceneOptions, SceneRig, simulate
from stcalib_ros.core.synthetic.rigs import staged
from stcalib_ros.io.mocap import shipped_clips

CLIPS = shipped_clips()
EXACT = SceneOptions(
    n_frames=60,
    sigma_px=0,
    lifter_mm=(0, 0),
    tilt_deg=0,
    crop_perspective=0,
    scale_error=0,
    flip_rate=0,
    id_switches_per_10s=0,
)
"""No errors at all."""


def observed(scene, camera):
    """Key points (N, P, 17, 2) and 3D joints (N, P, 17, 3) of a camera by true person."""
    cam = scene.recording.cameras[camera]
    keypoints = np.full((len(cam.stamps), len(scene.people), 17, 2), np.nan)
    joints = np.full((*keypoints.shape[:-1], 3), np.nan)
    for track in cam.tracks:
        at = track.frames, scene.track_persons[cam.name][track.track_id]
        keypoints[at], joints[at] = track.keypoints, track.joints
    return keypoints, joints


def points_cam(scene, camera, times):
    """True joints (T, P, 17, 3) in the optical frame, by the truth that is handed out."""
    truth = scene.truth.cameras[camera]
    ref = scene.joints_ref(times).swapaxes(0, 1)
    return (ref - truth.t_ref_cam) @ truth.R_ref_cam


def test_an_exact_scene_agrees_with_opencv_and_its_truth():
    scene = simulate(EXACT, clips=CLIPS)
    for c, camera in enumerate(scene.truth.cameras):
        stamps = scene.recording.cameras[c].stamps
        true_cam = points_cam(scene, c, stamps + camera.time_offset_s)
        keypoints, joints = observed(scene, c)
        zero = np.zeros(3)
        pixels, _ = cv2.projectPoints(
            true_cam.reshape(-1, 3), zero, zero, camera.intrinsics.K, camera.intrinsics.D
        )
        seen = np.isfinite(keypoints[..., 0])
        assert seen.mean() > 0.8
        np.testing.assert_allclose(
            keypoints[seen], pixels.reshape(keypoints.shape)[seen], atol=1e-6
        )
        known = np.isfinite(joints[:, :, 0, 0])
        relative = true_cam - true_cam[:, :, :1]
        np.testing.assert_allclose(joints[known], relative[known], atol=1e-9)


def test_the_truth_is_in_the_frame_and_clock_of_the_first_camera():
    scene = simulate(EXACT)
    first = scene.truth.cameras[0]
    np.testing.assert_allclose(first.R_ref_cam, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(first.t_ref_cam, 0, atol=1e-12)
    assert first.time_offset_s == first.clock_skew == 0
    assert scene.truth.metric
    assert evaluate(scene.truth, scene.truth, fps=30).E_R == 0


def test_offsets_are_subframe_and_within_the_range():
    frames = np.concatenate(
        [simulate(replace(EXACT, n_frames=4, seed=s)).offsets_s[1:] * 30 for s in range(40)]
    )
    assert np.abs(frames).max() <= 10
    assert frames.std() == pytest.approx(20 / np.sqrt(12), rel=0.15)
    assert np.abs(frames - np.round(frames)).mean() == pytest.approx(0.25, abs=0.05)


def test_clock_rates_hold_in_the_stamps():
    scene = simulate(replace(EXACT, skew_ppm=100.0))
    for camera, recorded, exposures in zip(
        scene.truth.cameras, scene.recording.cameras, scene.exposures_s, strict=True
    ):
        t = recorded.stamps
        np.testing.assert_allclose(
            t + camera.time_offset_s + camera.clock_skew * t, exposures, atol=1e-12
        )
    skews = np.array([camera.clock_skew for camera in scene.truth.cameras])
    assert skews[0] == 0
    assert 0 < np.abs(skews[1:]).max() <= 1e-4


def test_a_faster_camera_sees_the_same_motion():
    options = replace(EXACT, fps=(30.0, 60.0, 30.0, 25.0), max_offset_frames=0)
    scene = simulate(options, clips=CLIPS)
    counts = [len(camera.stamps) for camera in scene.recording.cameras]
    assert counts == [60, 120, 60, 50]
    fast, slow = scene.exposures_s[1], scene.exposures_s[0]
    np.testing.assert_allclose(
        scene.joints_world(fast)[:, ::2], scene.joints_world(slow), atol=1e-12
    )
    keypoints, _ = observed(scene, 1)
    true_cam = points_cam(scene, 1, fast)
    expected = project_visible(true_cam, scene.rig.intrinsics[1])
    seen = np.isfinite(keypoints[..., 0])
    np.testing.assert_allclose(keypoints[seen], expected[seen], atol=1e-6)


def test_jitter_and_dropped_frames():
    scene = simulate(replace(EXACT, n_frames=3000, n_people=1, stamp_jitter_s=0.003, drop_rate=0.1))
    for camera, exposures in zip(scene.recording.cameras, scene.exposures_s, strict=True):
        assert len(camera.stamps) == pytest.approx(2700, abs=5 * np.sqrt(270))
        assert (np.diff(camera.stamps) > 0).all()
        jitter = camera.stamps - exposures
        assert jitter.std() == pytest.approx(0.003, rel=0.1)


def test_keypoint_noise_has_the_stated_sigma():
    scene = simulate(replace(EXACT, n_frames=300, sigma_px=3.0), clips=CLIPS)
    errors = []
    for c in range(4):
        keypoints, _ = observed(scene, c)
        errors.append(
            keypoints
            - project_visible(points_cam(scene, c, scene.exposures_s[c]), scene.rig.intrinsics[c])
        )
    error = np.concatenate(errors).ravel()
    error = error[np.isfinite(error)]
    assert error.std() == pytest.approx(3, rel=0.02)
    assert abs(error.mean()) < 0.05
    assert scene.truth.reprojection_rms_px == pytest.approx(3 * np.sqrt(2), rel=0.02)


def test_lifter_error_is_within_its_range():
    scene = simulate(replace(EXACT, lifter_mm=(30.0, 60.0)), clips=CLIPS)
    levels = []
    for c in range(4):
        _, joints = observed(scene, c)
        true_cam = points_cam(scene, c, scene.exposures_s[c])
        error = np.linalg.norm(joints - (true_cam - true_cam[:, :, :1]), axis=-1)
        levels += [np.nanmean(error[:, p]) for p in range(3)]
    assert 0.027 < min(levels) < max(levels) < 0.066
    assert np.ptp(levels) > 0.005


def test_the_realistic_bias_reaches_the_keypoints():
    scene = simulate(replace(EXACT, keypoint_bias_mm=20.0), clips=CLIPS)
    # 20 mm per axis at about 4 m with a focal length of 1400 px.
    per_axis = scene.truth.reprojection_rms_px / np.sqrt(2)
    assert per_axis == pytest.approx(0.02 * 1400 / 4, rel=0.35)


def test_flips_exchange_left_and_right_in_the_stated_share_of_frames():
    options = replace(EXACT, n_frames=900, flip_rate=0.05)
    scene = simulate(options, clips=CLIPS)
    flipped = []
    for c in range(4):
        _, joints = observed(scene, c)
        true_cam = points_cam(scene, c, scene.exposures_s[c])
        known = np.isfinite(joints[:, :, 0, 0])
        wrong = np.abs(joints - true_cam + true_cam[:, :, :1]).max(axis=(2, 3)) > 1e-6
        flipped.append(wrong[known])
    assert np.concatenate(flipped).mean() == pytest.approx(0.05, rel=0.4)


def test_missing_people_and_their_tracks():
    options = SceneOptions(n_people=6, n_frames=600, missing=0.25, occlusions=True, seed=5)
    scene = simulate(options, clips=CLIPS)
    seen = 0
    for camera in scene.recording.cameras:
        assert len({t.track_id for t in camera.tracks}) == len(camera.tracks) > 6
        for track in camera.tracks:
            assert (np.diff(track.frames) > 0).all()
            assert 0 <= track.frames[0] <= track.frames[-1] < len(camera.stamps)
            n = len(track.frames)
            assert track.keypoints.shape == (n, 17, 2)
            assert track.joints.shape == (n, 17, 3)
            assert track.scores.shape == (n, 17)
            assert ((track.scores > 0) == np.isfinite(track.keypoints[..., 0])).all()
            seen += n
    assert 0.45 < seen / (4 * 6 * 600) < 0.8
    listed = {
        (name, track)
        for person in scene.truth.persons
        for name, tracks in person.tracks.items()
        for track in tracks
    }
    assert listed == {(c.name, t.track_id) for c in scene.recording.cameras for t in c.tracks}


def test_switched_tracks_belong_to_both_people():
    scene = simulate(replace(EXACT, n_frames=300, id_switches_per_10s=2.0), clips=CLIPS)
    n_mixed = 0
    for name, tracks in scene.track_persons.items():
        for track_id, shown in tracks.items():
            owners = {
                p.person_id for p in scene.truth.persons if track_id in p.tracks.get(name, ())
            }
            shares = np.bincount(shown, minlength=3) / len(shown)
            assert owners == set(np.flatnonzero(shares >= 0.2))
            n_mixed += len(owners) > 1
    assert n_mixed > 0


def test_same_seed_same_recording_and_other_seed_another():
    options = SceneOptions(n_frames=40, missing=0.2, keypoint_bias_mm=20, occlusions=True)
    a, b = (simulate(options, clips=CLIPS).recording for _ in range(2))
    for one, other in zip(a.cameras, b.cameras, strict=True):
        np.testing.assert_array_equal(one.stamps, other.stamps)
        for s, t in zip(one.tracks, other.tracks, strict=True):
            np.testing.assert_array_equal(s.keypoints, t.keypoints)
            np.testing.assert_array_equal(s.joints, t.joints)
    c = simulate(replace(options, seed=1), clips=CLIPS)
    assert not np.allclose(
        c.truth.cameras[1].t_ref_cam, simulate(options).truth.cameras[1].t_ref_cam
    )


def test_errors_can_be_changed_without_changing_the_scene():
    a, b = simulate(EXACT, clips=CLIPS), simulate(replace(EXACT, sigma_px=5), clips=CLIPS)
    np.testing.assert_array_equal(a.offsets_s, b.offsets_s)
    np.testing.assert_array_equal(a.joints_world(np.zeros(1)), b.joints_world(np.zeros(1)))


@pytest.mark.parametrize(
    ("model", "coefficients"),
    [
        (LensModel.PLUMB_BOB, [-0.2, 0.05, 0.001, -0.001, 0.0]),
        (LensModel.RATIONAL_POLYNOMIAL, [0.5, -0.1, 1e-4, 1e-4, 0.01, 0.8, -0.05, 0.02]),
        (LensModel.EQUIDISTANT, [-0.02, 0.005, -0.001, 0.0002]),
    ],
)
def test_given_rigs_keep_their_lenses_and_relative_poses(model, coefficients):
    ring = simulate(EXACT).rig
    K = np.array([[900.0, 0, 960], [0, 900, 540], [0, 0, 1]])
    lens = Intrinsics(1920, 1080, model, K, np.array(coefficients))
    turn = cv2.Rodrigues(np.array([0.3, -0.8, 0.4]))[0]
    rig = SceneRig(
        ring.names,
        (lens,) * 4,
        ring.R_cam_world @ turn,
        0.1 * (ring.t_cam_world + np.einsum("cab,b->ca", ring.R_cam_world, [1.0, 2.0, 3.0])),
    )
    scene = simulate(replace(EXACT, rig=rig, rig_scale=10.0), clips=CLIPS)
    expected = ring.R_cam_world[0] @ ring.R_cam_world[2].T
    np.testing.assert_allclose(scene.truth.cameras[2].R_ref_cam, expected, atol=1e-9)
    true_baseline = np.linalg.norm(ring.centres_world[0] - ring.centres_world[2])
    baseline = np.linalg.norm(scene.truth.cameras[2].t_ref_cam)
    assert baseline == pytest.approx(true_baseline, rel=1e-9)
    keypoints, _ = observed(scene, 2)
    seen = np.isfinite(keypoints[..., 0])
    assert seen.mean() > 0.5
    points = points_cam(scene, 2, scene.exposures_s[2])[seen]
    zero = np.zeros(3)
    if model is LensModel.EQUIDISTANT:
        pixels, _ = cv2.fisheye.projectPoints(points[:, None], zero, zero, K, lens.D)
    else:
        pixels, _ = cv2.projectPoints(points, zero, zero, K, lens.D)
    np.testing.assert_allclose(keypoints[seen], pixels.reshape(-1, 2), atol=1e-6)


def test_a_staged_rig_is_level_and_on_the_floor():
    ring = simulate(EXACT).rig
    rig = staged(ring)
    up = -rig.R_cam_world[:, 1].mean(axis=0)
    np.testing.assert_allclose(up / np.linalg.norm(up), [0, 0, 1], atol=1e-9)
    assert (np.abs(rig.centres_world[:, 2] - ring.centres_world[:, 2]) < 0.6).all()


def test_nothing_is_seen_beyond_the_image_or_where_the_lens_model_folds():
    K = np.array([[900.0, 0, 960], [0, 900, 540], [0, 0, 1]])
    lens = Intrinsics(1920, 1080, LensModel.PLUMB_BOB, K, np.array([-0.4, 0, 0, 0, 0]))
    points = np.array([[0, 0, 1.0], [0, 0, -1.0], [1.5, 0, 1], [0.5, 0, 1], [0, 0.9, 1]])
    seen = np.isfinite(project_visible(points, lens)[:, 0])
    assert seen.tolist() == [True, False, False, True, False]


def test_every_camera_has_a_principal_point_of_its_own():
    options = replace(EXACT, n_cameras=200, n_frames=2, n_people=1, principal_point_px=8.0)
    centres = np.array([c.intrinsics.K[:2, 2] for c in simulate(options).truth.cameras])
    np.testing.assert_allclose(centres.mean(0), [960, 540], atol=2.0)
    np.testing.assert_allclose(centres.std(0), 8.0, rtol=0.2)


def test_every_camera_can_have_a_focal_length_of_its_own_behind_the_same_model():
    lens = {"lens_model": "equidistant", "distortion": (0.02, -0.01)}
    options = replace(EXACT, focal_px=(700.0, 900.0, 800.0, 1000.0), **lens)
    scene = simulate(options)
    for c, (camera, focal) in enumerate(zip(scene.truth.cameras, options.focal_px, strict=True)):
        own = camera.intrinsics
        assert (own.model, own.K[0, 0], own.K[1, 1]) == (LensModel.EQUIDISTANT, focal, focal)
        assert own.K[:2, 2].tolist() == [960, 540]
        assert own.D.tolist() == [0.02, -0.01, 0.0, 0.0]
        stamps = scene.recording.cameras[c].stamps
        X = points_cam(scene, c, stamps + camera.time_offset_s).reshape(-1, 3)
        angle = np.arctan2(np.hypot(X[:, 0], X[:, 1]), X[:, 2])
        radius = focal * (angle + 0.02 * angle**3 - 0.01 * angle**5)
        pixels = own.K[:2, 2] + radius[:, None] * X[:, :2] / np.hypot(X[:, :1], X[:, 1:2])
        keypoints, _ = observed(scene, c)
        seen = np.isfinite(keypoints[..., 0])
        assert seen.mean() > 0.8
        np.testing.assert_allclose(keypoints[seen], pixels.reshape(keypoints.shape)[seen])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"n_cameras": 0}, "n_cameras must be 1 to 1000, got 0"),
        ({"n_frames": 1}, "n_frames must be 2 to"),
        ({"sigma_px": -1.0}, "sigma_px must be 0 to"),
        ({"sigma_px": float("nan")}, "sigma_px must be 0 to 10000, got nan"),
        ({"missing": 1.0}, "missing must be a fraction"),
        ({"drop_rate": -0.1}, "drop_rate must be a fraction"),
        ({"people": "robots"}, "expected one of mocap, procedural, standing, gesturing"),
        ({"fps": (30.0, 25.0)}, "2 values for 4 cameras"),
        ({"fps": 0.0}, "fps must be 0.1 to 1000"),
        ({"lifter_mm": (30.0,)}, "lifter_mm must be two numbers"),
        ({"focal_px": 0.0}, "focal_px must be 1 to"),
        ({"focal_px": (900.0, 1000.0)}, "focal_px: 2 values for 4 cameras"),
        ({"lens_model": "fisheye"}, "expected one of plumb_bob, rational_polynomial, equidistant"),
        (
            {"lens_model": "equidistant", "distortion": (0.1,) * 5},
            "equidistant has 4 coefficients, got 5",
        ),
    ],
)
def test_bad_options_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        SceneOptions(**given)


def test_bad_rigs_are_refused():
    ring = simulate(EXACT).rig
    with pytest.raises(InputError, match="given twice"):
        replace(ring, names=("a", "a", "b", "c"))
    with pytest.raises(InputError, match="4 names but 3 intrinsics"):
        replace(ring, intrinsics=ring.intrinsics[:3])
    with pytest.raises(InputError, match="expected R of shape"):
        replace(ring, R_cam_world=np.eye(3))
