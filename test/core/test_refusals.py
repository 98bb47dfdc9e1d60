"""Recordings that cannot be calibrated, or only in part, and what is said about them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import (
    HALF_SECOND,
    SMALL,
    changed,
    clock_shifted,
    error,
    every,
    tracks_changed,
)

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.recording import CameraRecording, Recording, Track
from stcalib_ros.core.model.rejection import RejectionReason, RemarkCode
from stcalib_ros.core.options import Options
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.synthetic import Scene, SceneOptions, scene, simulate
from stcalib_ros.core.synthetic.rigs import ring_rig

FOUR = replace(SMALL, n_cameras=4, n_frames=100)


@pytest.fixture(scope="module")
def four() -> Scene:
    return simulate(FOUR)


@pytest.fixture(scope="module")
def strangers() -> Scene:
    return simulate(replace(FOUR, seed=77))


AS_STAMPED = replace(HALF_SECOND, align="stamps")


def verdict(recording: Recording, options: Options = HALF_SECOND) -> Calibration:
    calibration = calibrate(recording, options)
    assert "\n" not in calibration.message
    assert calibration.message
    if calibration.status is not Status.OK:
        return calibration
    named = [c.name for c in (*calibration.cameras, *calibration.uncalibrated)]
    assert sorted(named) == sorted(c.name for c in recording.cameras)
    assert calibration.reference in [c.name for c in calibration.cameras]
    assert len(calibration.cameras) >= 2
    return calibration


def reasons(calibration):
    return {c.name: c.rejection.reason for c in calibration.uncalibrated}


def refusals(calibration):
    return [rejection.reason for rejection in calibration.rejections]


def first(n):
    """A camera that recorded n images only."""

    def part(track: Track) -> Track:
        rows = track.frames < n
        return Track(
            track.track_id,
            track.frames[rows],
            track.keypoints[rows],
            track.joints[rows],
            track.scores[rows],
        )

    def change(camera: CameraRecording) -> CameraRecording:
        tracks = tuple(part(t) for t in camera.tracks)
        return replace(camera, stamps=camera.stamps[:n], tracks=tracks)

    return change


def nothing_seen(camera):
    unseen = tracks_changed(lambda t: replace(t, keypoints=np.full_like(t.keypoints, np.nan)))
    return unseen(camera)


def normalised(camera):
    size = [camera.intrinsics.width, camera.intrinsics.height]
    return tracks_changed(lambda t: replace(t, keypoints=t.keypoints / size))(camera)


def at_one_place(camera):
    return tracks_changed(lambda t: replace(t, keypoints=np.full_like(t.keypoints, 9.0)))(camera)


ALL = ["cam0", "cam1", "cam2", "cam3"]


def assert_the_rest_is_calibrated(calibration, truth, names):
    assert calibration.status is Status.OK, calibration.message
    assert [c.name for c in calibration.cameras] == names
    e = error(calibration, truth)
    assert e.E_R < 0.01
    assert e.E_t < 0.02
    assert calibration.message.startswith(f"{len(names)} of 4 cameras calibrated; ")


# Nothing to be had


def test_one_camera(four):
    calibration = verdict(replace(four.recording, cameras=four.recording.cameras[:1]))
    assert calibration.status is Status.INSUFFICIENT_DATA
    assert refusals(calibration) == [RejectionReason.TOO_FEW_CAMERAS]
    assert calibration.cameras == ()
    assert np.isnan(calibration.reprojection_rms_px)


def test_two_cameras_of_one_name(four):
    twice = replace(four.recording, cameras=four.recording.cameras[:1] * 2)
    with pytest.raises(InputError, match="two cameras are called 'cam0'"):
        calibrate(twice)


def test_an_unknown_reference(four):
    with pytest.raises(InputError, match="'door' is not in the recording: there are cam0, cam1"):
        calibrate(four.recording, replace(HALF_SECOND, reference="door"))


def test_clocks_an_hour_apart(four):
    cameras = tuple(clock_shifted(3600.0 * k)(c) for k, c in enumerate(four.recording.cameras))
    calibration = verdict(replace(four.recording, cameras=cameras), AS_STAMPED)
    assert calibration.status is Status.INSUFFICIENT_DATA
    assert refusals(calibration) == [RejectionReason.TOO_FEW_CAMERAS]
    others = ("cam1", "cam2", "cam3")
    assert reasons(calibration) == dict.fromkeys(others, RejectionReason.CLOCK_EPOCH_DIFFERS)
    assert "recorded at another time than the others" in calibration.message
    assert all(name in calibration.message for name in others)


def test_fewer_than_twelve_common_frames(four):
    calibration = verdict(every(four.recording, first(11)))
    assert calibration.status is Status.INSUFFICIENT_DATA
    assert set(reasons(calibration).values()) == {RejectionReason.NO_TEMPORAL_OVERLAP}


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("switches", [0.0, 1.0])
def test_nobody_moving(seed, switches):
    still = simulate(replace(FOUR, people="standing", seed=seed, id_switches_per_10s=switches))
    calibration = verdict(still.recording)
    assert calibration.status is Status.DEGENERATE
    still_or_ambiguous = (
        RejectionReason.NO_MOTION,
        RejectionReason.RIVAL_SOLUTION,
        RejectionReason.OFFSET_AMBIGUOUS,
        RejectionReason.OFFSET_AMBIGUOUS_WITH_OUTLIERS,
        RejectionReason.LIMBS_DISAGREE,
    )
    assert refusals(calibration)[0] in still_or_ambiguous


def test_nothing_seen_by_anybody(four):
    def unseen(track):
        return replace(track, keypoints=np.full_like(track.keypoints, np.nan))

    calibration = verdict(every(four.recording, tracks_changed(unseen)))
    assert calibration.status is Status.INSUFFICIENT_DATA
    assert set(reasons(calibration).values()) == {RejectionReason.NO_PERSONS}


@pytest.mark.parametrize(
    ("change", "reason", "says"),
    [
        (normalised, RejectionReason.KEYPOINTS_NORMALISED, "look like fractions of the image"),
        (at_one_place, RejectionReason.KEYPOINTS_COINCIDE, "are at the same place"),
    ],
)
def test_keypoints_that_are_those_of_nobody(four, change, reason, says):
    calibration = verdict(every(four.recording, change))
    assert calibration.status is Status.INSUFFICIENT_DATA
    assert reasons(calibration) == dict.fromkeys(ALL, reason)
    assert calibration.message.count(says) == 1
    assert all(name in calibration.message for name in ALL)


def test_poses_of_nobody_are_left_out_of_a_calibration_that_says_so(four):
    def now_and_then(track):
        keypoints = track.keypoints.copy()
        keypoints[::10] = 9.0
        return replace(track, keypoints=keypoints)

    calibration = verdict(changed(four.recording, "cam1", tracks_changed(now_and_then)))
    assert_the_rest_is_calibrated(calibration, four.truth, ALL)
    (remark,) = (r for r in calibration.remarks if r.code is RemarkCode.POSES_LEFT_OUT)
    assert remark.cameras == ("cam1",)
    left_out = sum(len(t.frames[::10]) for t in four.recording.cameras[1].tracks)
    assert remark.values["n_left_out"] == left_out


# A part of it


def without(names, *left_out):
    return [n for n in names if n not in left_out]


@pytest.mark.parametrize("k", range(4))
def test_a_camera_that_watches_other_people(four, strangers, k):
    cameras = list(four.recording.cameras)
    cameras[k] = strangers.recording.cameras[k]
    calibration = verdict(replace(four.recording, cameras=tuple(cameras)))
    assert_the_rest_is_calibrated(calibration, four.truth, without(ALL, f"cam{k}"))
    assert reasons(calibration)[f"cam{k}"]


def test_two_groups_of_cameras(four, strangers):
    cameras = (*four.recording.cameras[:2], *strangers.recording.cameras[2:])
    calibration = verdict(replace(four.recording, cameras=cameras))
    assert_the_rest_is_calibrated(calibration, four.truth, ["cam0", "cam1"])
    for name in ("cam2", "cam3"):
        assert reasons(calibration)[name] is RejectionReason.DISCONNECTED
    assert "form a separate group" in calibration.message


@pytest.mark.parametrize("name", ["cam0", "cam2"])
@pytest.mark.parametrize(
    "change",
    [nothing_seen, lambda c: replace(c, tracks=())],
    ids=["no keypoints", "no tracks"],
)
def test_a_camera_that_saw_nobody(four, name, change):
    calibration = verdict(changed(four.recording, name, change))
    assert_the_rest_is_calibrated(calibration, four.truth, without(ALL, name))
    assert reasons(calibration) == {name: RejectionReason.NO_PERSONS}
    assert calibration.reference == ("cam1" if name == "cam0" else "cam0")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (clock_shifted(3600.0), RejectionReason.CLOCK_EPOCH_DIFFERS),
        (first(11), RejectionReason.NO_TEMPORAL_OVERLAP),
        (first(0), RejectionReason.NO_PERSONS),
        (normalised, RejectionReason.KEYPOINTS_NORMALISED),
        (at_one_place, RejectionReason.KEYPOINTS_COINCIDE),
    ],
    ids=["clock", "eleven images", "no image", "normalised", "one place"],
)
def test_a_camera_that_cannot_be_compared(four, change, reason):
    calibration = verdict(changed(four.recording, "cam3", change), AS_STAMPED)
    assert_the_rest_is_calibrated(calibration, four.truth, without(ALL, "cam3"))
    assert reasons(calibration) == {"cam3": reason}


def test_an_offset_beyond_the_range_is_found_or_the_camera_is_left_out(four):
    calibration = verdict(changed(four.recording, "cam3", clock_shifted(1.8)))
    if reasons(calibration):
        assert_the_rest_is_calibrated(calibration, four.truth, without(ALL, "cam3"))
        return
    assert_the_rest_is_calibrated(calibration, four.truth, ALL)
    true = four.truth.cameras[3].time_offset_s - 1.8
    assert calibration.cameras[3].time_offset_s == pytest.approx(true, abs=0.01)


# Never a wrong one that is called right


def assert_never_wrong_and_ok(options: SceneOptions, n: int) -> list[Status]:
    statuses = []
    for seed in range(n):
        hard = simulate(replace(options, seed=seed))
        calibration = calibrate(hard.recording, HALF_SECOND)
        statuses.append(calibration.status)
        if calibration.status is Status.OK:
            e = error(calibration, hard.truth)
            assert e.E_R < 0.1, (seed, e)
            assert e.E_delta < 1.0, (seed, e)
    return statuses


def test_short_clips_with_bad_poses_are_right_or_not_ok():
    hard = SceneOptions(n_frames=40, n_people=2, lifter_mm=(110.0, 110.0))
    statuses = assert_never_wrong_and_ok(hard, 6)
    assert statuses.count(Status.OK) >= 3


def test_people_who_move_identically_are_told_apart_or_it_is_not_ok(monkeypatch):
    real = scene.make_people

    def identical(*args):
        one, *others = real(*args)

        def displaced(k):
            return lambda times: one(times) + np.array([1.1 * k, 0.4 * k, 0.0])

        return (one, *(displaced(k + 1) for k in range(len(others))))

    monkeypatch.setattr(scene, "make_people", identical)
    assert_never_wrong_and_ok(SceneOptions(n_frames=80, n_people=2), 5)


# Recordings at the edge


def test_no_camera_at_all():
    with pytest.raises(InputError, match="no camera"):
        calibrate(Recording(()), HALF_SECOND)


@pytest.mark.parametrize("n", [12, 15])
def test_people_who_walk_in_a_short_clip_are_not_said_to_stand(n):
    short = every(simulate(replace(SMALL, n_cameras=4)).recording, first(n))
    assert RejectionReason.NO_MOTION not in refusals(calibrate(short, HALF_SECOND))


@pytest.mark.parametrize("seed", [0, 1, 3, 4])
def test_two_cameras_at_one_place(seed):
    rig = ring_rig(
        np.random.default_rng(seed),
        2,
        image_size=(1920, 1080),
        focal_px=1000.0,
        radius_m=(3.5, 5.0),
        height_m=(1.5, 2.5),
    )
    R = np.stack([rig.R_cam_world[0], exp_so3(np.array([0.0, 0.12, 0.05])) @ rig.R_cam_world[0]])
    t = -np.einsum("cij,j->ci", R, rig.centres_world[0])
    turned = replace(rig, R_cam_world=R, t_cam_world=t)
    scene = simulate(replace(FOUR, rig=turned, n_cameras=2, seed=seed))
    calibration = verdict(scene.recording)
    assert calibration.status is Status.DEGENERATE
    assert refusals(calibration)[0] is RejectionReason.NO_PARALLAX
