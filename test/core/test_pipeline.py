"""The whole calibration: closed forms, and what must not change it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import (
    EXACT,
    FRAME_S,
    HALF_SECOND,
    SMALL,
    changed,
    clock_shifted,
    error,
    every,
    parameters,
    tracks_changed,
    whole_frame_offsets,
)

from stcalib_ros.core.errors import Cancelled
from stcalib_ros.core.evaluation.metrics import evaluate
from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.keypoint_layouts import layout_from_names
from stcalib_ros.core.model.recording import Track
from stcalib_ros.core.options import BundleOptions, Options
from stcalib_ros.core.pipeline import calibrate, run_stages
from stcalib_ros.core.synthetic import SceneOptions, simulate

NAMES = ["cam0", "cam1", "cam2"]


@pytest.fixture(scope="module")
def found(small_stages) -> Calibration:
    return small_stages.calibration


def deviations(calibration):
    return np.array(
        [[*np.sqrt(np.diag(c.covariance)), c.time_offset_stddev_s] for c in calibration.cameras]
    )


def assert_alike(one, two, share):
    """Poses and offsets agree within a share of their predicted deviations."""
    assert one.status is two.status is Status.OK
    difference = np.abs(parameters(one, NAMES) - parameters(two, NAMES))
    assert (difference[1:] <= share * deviations(two)[1:] + 1e-9).all(), difference
    assert one.reprojection_rms_px == pytest.approx(two.reprojection_rms_px, rel=1e-3)


# Closed forms


@pytest.mark.parametrize(
    "options",
    [EXACT, replace(EXACT, lifter_mm=(30, 60), tilt_deg=3, crop_perspective=1, scale_error=0.04)],
    ids=["exact poses", "poses of a usual lifter"],
)
def test_exact_key_points_and_offsets_of_whole_frames_give_the_truth(options):
    scene = simulate(options)
    frames = (0, 7, -4, -9)
    calibration = calibrate(whole_frame_offsets(scene, frames), HALF_SECOND)
    e = error(calibration, scene.truth)
    assert calibration.status is Status.OK
    assert e.E_R < 1e-6
    assert e.E_t < 1e-6
    offsets = [c.time_offset_s for c in calibration.cameras]
    np.testing.assert_allclose(offsets, np.array(frames) * FRAME_S, atol=1e-6 * FRAME_S)
    assert calibration.reprojection_rms_px < 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_exact_key_points_at_offsets_between_frames_leave_what_the_motion_model_neglects(seed):
    scene = simulate(replace(EXACT, max_offset_frames=8, seed=seed))
    e = error(calibrate(scene.recording, HALF_SECOND), scene.truth)
    assert e.E_R < 1e-4
    assert e.E_t < 2e-4
    assert e.E_delta < 2e-3


def test_a_usual_scene_is_within_the_usual_level(found, small_scene):
    e = error(found, small_scene.truth)
    assert found.status is Status.OK
    assert found.message.startswith("3 of 3 cameras calibrated; ")
    assert e.E_R < 0.003
    assert e.E_t < 0.003
    assert e.E_delta < 0.06
    # 3 px on both axes, and three of the six coordinates of a point fitted.
    assert 2.0 < e.E_2D < 4.3
    assert e.precision == e.recall == 1


def test_metric_poses_give_metres(found, small_scene):
    assert found.metric
    assert evaluate(found, small_scene.truth).scale == pytest.approx(1, abs=0.1)


# What must not change the result


def test_the_same_input_gives_the_same_output_bit_by_bit(found, small_scene):
    again = calibrate(small_scene.recording, HALF_SECOND)
    np.testing.assert_array_equal(parameters(again), parameters(found))
    np.testing.assert_array_equal(again.joint_covariance, found.joint_covariance)
    assert again.reprojection_rms_px == found.reprojection_rms_px
    assert again.persons == found.persons
    assert again.pairs == found.pairs


@pytest.mark.parametrize("order", [(2, 1, 0), (1, 0, 2)])
def test_the_order_of_the_cameras_does_not_matter(found, small_scene, order):
    cameras = small_scene.recording.cameras
    permuted = replace(small_scene.recording, cameras=tuple(cameras[k] for k in order))
    other = calibrate(permuted, HALF_SECOND)
    assert [c.name for c in other.cameras] == [cameras[k].name for k in order]
    assert other.reference == cameras[order[0]].name
    assert_alike(other, found, 0.1)


def test_another_reference_gives_the_same_geometry(found, small_scene):
    other = calibrate(small_scene.recording, replace(HALF_SECOND, reference="cam2"))
    assert other.reference == "cam2"
    reference = other.cameras[2]
    np.testing.assert_allclose(reference.R_ref_cam, np.eye(3), atol=1e-12)
    assert not reference.t_ref_cam.any()
    assert reference.time_offset_s == 0
    assert not reference.covariance.any()
    assert_alike(other, found, 0.1)


@pytest.mark.parametrize("seconds", [-3.3, 1e5])
def test_a_time_that_is_added_to_all_clocks_changes_nothing(found, small_scene, seconds):
    later = every(small_scene.recording, clock_shifted(seconds))
    other = calibrate(later, HALF_SECOND)
    assert_alike(other, found, 0.01)
    np.testing.assert_allclose(np.subtract(other.window_s, found.window_s), seconds, atol=1e-3)


def test_a_time_added_to_one_clock_is_taken_from_its_offset(found, small_scene):
    shifted = changed(small_scene.recording, "cam1", clock_shifted(0.25))
    other = calibrate(shifted, HALF_SECOND)
    cameras = tuple(
        replace(c, time_offset_s=c.time_offset_s + 0.25) if c.name == "cam1" else c
        for c in other.cameras
    )
    assert other.cameras[1].time_offset_s < found.cameras[1].time_offset_s - 0.24
    assert_alike(replace(other, cameras=cameras), found, 0.05)


def test_a_reversed_pair_has_the_inverse_pose(small_scene):
    two = small_scene.recording.cameras[:2]
    forth, back = (
        calibrate(replace(small_scene.recording, cameras=pair), HALF_SECOND).cameras
        for pair in (two, two[::-1])
    )
    a_b, b_a = forth[1], back[1]
    assert rotation_angle(a_b.R_ref_cam @ b_a.R_ref_cam) < 3e-4
    direction = -a_b.R_ref_cam @ b_a.t_ref_cam
    cosine = direction @ a_b.t_ref_cam / np.linalg.norm(direction) / np.linalg.norm(a_b.t_ref_cam)
    assert np.arccos(min(cosine, 1.0)) < 3e-4
    assert a_b.time_offset_s == pytest.approx(-b_a.time_offset_s, abs=0.01 * FRAME_S)


@pytest.mark.parametrize("factor", [0.01, 300.0])
def test_the_unit_of_poses_up_to_scale_does_not_matter(small_scene, factor):
    plain = every(small_scene.recording, lambda c: replace(c, metric=False))
    scaled = every(plain, tracks_changed(lambda t: replace(t, joints=factor * t.joints)))
    one, two = (calibrate(r, HALF_SECOND) for r in (plain, scaled))
    assert not one.metric
    assert not two.metric
    np.testing.assert_allclose(parameters(two), parameters(one), atol=1e-9)
    assert np.linalg.norm(one.cameras[1].t_ref_cam) == pytest.approx(1)


def test_numbers_and_order_of_tracks_do_not_matter(found, small_scene):
    def renamed(camera):
        tracks = [replace(t, track_id=100 - t.track_id) for t in camera.tracks[::-1]]
        return replace(camera, tracks=tuple(tracks))

    other = calibrate(every(small_scene.recording, renamed), HALF_SECOND)
    assert_alike(other, found, 1e-6)

    def people(calibration, number):
        return {
            frozenset((name, number(i)) for name, ids in p.tracks.items() for i in ids)
            for p in calibration.persons
        }

    assert people(other, lambda i: 100 - i) == people(found, lambda i: i)


def test_images_without_anybody_do_not_matter(found, small_scene):
    def longer(camera):
        tail = camera.stamps[-1] + FRAME_S * np.arange(1, 20)
        return replace(camera, stamps=np.concatenate([camera.stamps, tail]))

    assert_alike(calibrate(every(small_scene.recording, longer), HALF_SECOND), found, 0.3)


# Stages


def test_every_stage_can_be_looked_at(small_stages):
    assert len(small_stages.lifted) == 3
    assert {(h.a, h.b) for h in small_stages.hypotheses} == {(0, 1), (0, 2), (1, 2)}
    assert all(h.support > 0.0 and np.isfinite(h.epipolar_px) for h in small_stages.hypotheses)
    assert small_stages.rigs[0].support == max(r.support for r in small_stages.rigs)
    assert len(small_stages.iterations) >= 2


def test_errors_fall_from_stage_to_stage(small_stages, small_scene):
    true = np.stack([c.R_ref_cam for c in small_scene.truth.cameras])

    def angle(rig):
        return rotation_angle(np.swapaxes(rig.R_ref_cam, 1, 2) @ true)[1:].mean()

    integrated = angle(small_stages.rigs[0])
    adjusted = angle(small_stages.iterations[-1].rig)
    assert integrated < 0.02
    assert adjusted < 0.5 * integrated
    assert adjusted < 1e-3


STAGES = [
    "checking the input",
    "matching camera pairs",
    "joining all cameras",
    "first joint refinement",
    "joint refinement",
    "checking the result",
]


def test_the_joint_covariance_is_asked_by_name(small_stages):
    joint, calibration = small_stages.covariance, small_stages.calibration
    for camera in calibration.cameras[1:]:
        offset_s = joint.stddev(f"{camera.name}.time_offset")[0]
        assert offset_s == pytest.approx(camera.time_offset_stddev_s, rel=0.05)
    cross = joint.covariance("cam1.translation", "cam2.time_offset")
    assert cross.shape == (3, 1)
    np.testing.assert_allclose(cross, joint.covariance("cam2.time_offset", "cam1.translation").T)


def test_one_round_ends_with_all_joints_and_without_outliers():
    scene = simulate(SceneOptions(seed=1000))
    stages = run_stages(scene.recording, Options(bundle=BundleOptions(rounds=1)))
    last = stages.iterations[-1]
    assert stages.calibration.status is Status.OK
    assert last.observations.x.shape[2] == stages.skeleton.layout.n_joints
    assert len(last.observations.person) * last.observations.x.shape[2] > 5000
    assert evaluate(stages.calibration, scene.truth).E_R < 0.002


@pytest.fixture(scope="module")
def ticks(small_scene):
    seen = []
    calibrate(small_scene.recording, HALF_SECOND, progress=lambda *tick: seen.append(tick))
    return seen


def test_progress_names_the_stages_in_order_and_rises_in_each(ticks):
    stages = [stage for stage, _ in ticks]
    assert list(dict.fromkeys(stages)) == STAGES
    assert stages == sorted(stages, key=STAGES.index)
    for stage in STAGES:
        fractions = [f for s, f in ticks if s == stage]
        assert fractions == sorted(fractions)
        assert 0 <= fractions[0] <= fractions[-1] <= 1


@pytest.mark.parametrize("stage", STAGES)
def test_it_can_be_stopped_in_every_stage(small_scene, ticks, stage):
    last = max(k for k, (name, _) in enumerate(ticks) if name == stage)
    reported = []
    with pytest.raises(Cancelled, match=f"cancelled during {stage}"):
        calibrate(
            small_scene.recording,
            HALF_SECOND,
            progress=lambda *tick: reported.append(tick),
            cancelled=lambda: len(reported) == last,
        )
    assert reported == ticks[:last]


def test_the_error_is_told_once_there_is_one(found, small_scene):
    events = []
    calibrate(
        small_scene.recording,
        HALF_SECOND,
        progress=lambda stage, _: events.append(stage),
        adjusted=events.append,
    )
    told = [event for event in events if isinstance(event, float)]
    assert len(told) == events.count("joint refinement")
    assert all(isinstance(e, str) for e in events[: events.index("joint refinement") - 1])
    assert np.isfinite(told).all()
    assert told[-1] == pytest.approx(found.reprojection_rms_px, rel=0.2)


def test_who_is_not_cancelled_is_not_disturbed(found, small_scene):
    other = calibrate(small_scene.recording, HALF_SECOND, cancelled=lambda: False)
    np.testing.assert_array_equal(parameters(other), parameters(found))


# Other recordings


@pytest.mark.parametrize(
    "changes",
    [
        {"fps": (30.0, 60.0, 25.0)},
        {"stamp_jitter_s": 0.004, "drop_rate": 0.1},
        {"n_people": 1, "n_frames": 120},
        {"n_cameras": 2},
        {"id_switches_per_10s": 1.0, "n_frames": 150},
        {"missing": 0.2, "n_people": 4, "n_frames": 120},
    ],
    ids=["mixed rates", "jitter and drops", "one person", "two cameras", "switches", "missing"],
)
def test_it_copes_with(changes):
    scene = simulate(replace(SMALL, **changes))
    calibration = calibrate(scene.recording, HALF_SECOND)
    e = error(calibration, scene.truth)
    assert calibration.status is Status.OK, calibration.message
    assert not e.missing
    assert e.E_R < 0.01
    assert e.E_t < 0.02
    assert e.E_delta < 0.3


def reduced_to(names):
    """A camera whose detector knows these joints only, in this order."""

    def change(camera):
        columns = [camera.layout.index(n) for n in names]

        def part(track: Track) -> Track:
            return Track(
                track.track_id,
                track.frames,
                track.keypoints[:, columns],
                track.joints[:, columns],
                track.scores[:, columns],
            )

        layout = layout_from_names(names, name="limbs")
        return replace(camera, layout=layout, tracks=tuple(part(t) for t in camera.tracks))

    return change


def test_cameras_of_different_layouts_are_calibrated_on_what_they_share(small_scene):
    limbs = [
        f"{side}_{joint}"
        for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
        for side in ("right", "left")
    ]
    mixed = changed(small_scene.recording, "cam1", reduced_to(limbs))
    stages = run_stages(mixed, HALF_SECOND)
    assert set(stages.skeleton.layout.joint_names) == set(limbs)
    e = error(stages.calibration, small_scene.truth)
    assert stages.calibration.status is Status.OK
    assert e.E_R < 0.005
    assert e.E_t < 0.01


def test_infinite_values_are_as_good_as_unknown_ones(found, small_scene):
    def broken(track):
        keypoints, joints = track.keypoints.copy(), track.joints.copy()
        keypoints[::7, 3], joints[::5, 4] = np.inf, -np.inf
        return replace(track, keypoints=keypoints, joints=joints)

    other = calibrate(every(small_scene.recording, tracks_changed(broken)), HALF_SECOND)
    assert other.status is Status.OK
    e = evaluate(other, found)
    assert e.E_R < 0.002
    assert e.E_t < 0.002
