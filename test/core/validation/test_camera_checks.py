"""Checks of cameras, and the rejections that follow from them."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from core_helpers import HALF_SECOND, SOUND, tracks_changed

from stcalib_ros.core.bundle.covariance import pose_covariance
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.rejection import RejectionReason
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.validation.camera_checks import check_cameras, rejection
from stcalib_ros.core.validation.thresholds import DEFAULT, CheckThresholds

NAN = float("nan")


def test_sound_checks_give_no_rejection():
    assert rejection(SOUND) is None
    assert rejection(replace(SOUND, shared_s=1.0)) is None
    assert rejection(replace(SOUND, explained_fraction=0.2)) is None


@pytest.mark.parametrize(
    ("change", "reason", "measured"),
    [
        ({"inliers": 150}, "TOO_FEW_INLIERS", 150),
        ({"inlier_fraction": 0.3}, "TOO_MANY_OUTLIERS", 0.3),
        ({"shared_s": 1.3, "explained_fraction": 0.6}, "TOO_LITTLE_SHARED_TIME", 1.3),
        ({"explained_fraction": 0.2, "rotation_stddev": 0.01}, "TOO_LITTLE_EXPLAINED", 0.2),
        ({"explained_fraction": 0.2, "offset_peak_ratio": 1.9}, "TOO_LITTLE_EXPLAINED", 0.2),
        ({"bone_rotation": 1.0}, "BONES_DISAGREE", 1.0),
        ({"depth_ratio": 1.7}, "DISTANCES_DISAGREE", 1.7),
        ({"depth_ratio": 0.5}, "DISTANCES_DISAGREE", 0.5),
        ({"limb_variation": 0.2}, "LIMBS_DISAGREE", 0.2),
        ({"limb_variation": float("inf")}, "LIMBS_DISAGREE", float("inf")),
        ({"bone_rotation": NAN, "limb_variation": NAN}, "NOTHING_TO_VERIFY", NAN),
        ({"explained_fraction": 0.2, "limb_variation": 0.1}, "TOO_LITTLE_EXPLAINED", 0.2),
        ({"explained_fraction": 0.2, "limb_variation": NAN}, "TOO_LITTLE_EXPLAINED", 0.2),
        ({"rotation_stddev": 0.05}, "ROTATION_UNCERTAIN", 0.05),
        ({"rotation_stddev": NAN}, "ROTATION_UNCERTAIN", NAN),
        ({"position_stddev": 0.2}, "POSITION_UNCERTAIN", 0.2),
        ({"offset_peak_ratio": 1.05}, "OFFSET_AMBIGUOUS", 1.05),
        ({"offset_peak_ratio": NAN}, "OFFSET_AMBIGUOUS", NAN),
        ({"repetition_ratio": 0.9, "period_s": 1.2}, "OFFSET_AMBIGUOUS", 0.9),
        ({"offset_stddev_frames": 2.5}, "OFFSET_UNCERTAIN", 2.5),
        ({"offset_stddev_frames": float("inf")}, "OFFSET_UNCERTAIN", float("inf")),
        (
            {"inlier_fraction": 0.75, "offset_peak_ratio_with_outliers": 1.02},
            "OFFSET_AMBIGUOUS_WITH_OUTLIERS",
            1.02,
        ),
        ({"has_lookalikes": True}, "LOOKALIKES", NAN),
    ],
)
def test_every_weakness_has_its_code_and_number(change, reason, measured):
    found = rejection(replace(SOUND, **change), camera="cam1")
    assert found is not None
    assert found.reason is RejectionReason(reason)
    assert found.cameras == ("cam1",)
    assert found.measured == pytest.approx(measured, nan_ok=True)


@pytest.mark.parametrize(
    "unknown",
    [
        {"bone_rotation": NAN},
        {"bone_rotation": NAN, "explained_fraction": 0.2},
        {"limb_variation": NAN},
        {"depth_ratio": NAN},
    ],
)
def test_what_is_unknown_is_not_a_failure(unknown):
    assert rejection(replace(SOUND, **unknown)) is None


UNEXPLAINED = {"explained_fraction": 0.2}
LIMITS = {
    "min_inliers": (6000, {}),
    "min_inlier_fraction": (0.99, {}),
    "min_explained_fraction": (0.95, {"rotation_stddev": 0.01}),
    "min_shared_s": (9.0, {"explained_fraction": 0.6}),
    "min_explained_fraction_if_short": (0.95, {"shared_s": 2.0}),
    "certain_rotation_stddev": (0.0005, UNEXPLAINED),
    "certain_bone_rotation": (0.01, UNEXPLAINED),
    "certain_limb_variation": (0.01, UNEXPLAINED),
    "max_limb_variation": (0.01, {}),
    "certain_offset_peak_ratio": (10.0, UNEXPLAINED),
    "max_bone_rotation": (0.01, {}),
    "max_depth_ratio": (1.2, {"depth_ratio": 1.5}),
    "min_repetition_ratio": (2.0, {"repetition_ratio": 1.5}),
    "max_rotation_stddev": (0.0005, {}),
    "max_position_stddev": (0.001, {}),
    "max_offset_stddev_frames": (0.001, {}),
    "min_offset_peak_ratio": (7.0, {}),
    "min_offset_peak_ratio_with_outliers": (3.0, {"offset_peak_ratio_with_outliers": 2.0}),
}
ELSEWHERE = {"many_outliers", "max_failed_fraction"}


@pytest.mark.parametrize(
    "name", [f.name for f in fields(CheckThresholds) if f.name not in ELSEWHERE]
)
def test_decisions_follow_the_limits_given(name):
    limit, change = LIMITS[name]
    checks = replace(SOUND, **change)
    assert rejection(checks) is None
    assert rejection(checks, replace(DEFAULT, **{name: limit})) is not None


@pytest.fixture(scope="module")
def last(small_stages):
    return small_stages.iterations[-1]


def checks_of(stages, last):
    covariance = pose_covariance(last.observations, last.state)
    return check_cameras(stages.lifted, stages.skeleton, last, covariance, offset_range_s=0.5)


def test_the_checks_of_a_good_calibration_is_sound(small_stages, last):
    for one in checks_of(small_stages, last):
        assert rejection(one) is None
        assert one.inlier_fraction > 0.9
        # Lifters of 30 to 60 mm and a size prior of 4 %.
        assert one.bone_rotation < 0.1
        assert one.depth_ratio == pytest.approx(1, abs=0.1)


def test_poses_that_are_turned_are_noticed(small_scene):
    def turned(camera, angle):
        R = exp_so3(np.array([0.0, angle, 0.0]))
        return tracks_changed(lambda track: replace(track, joints=track.joints @ R.T))(camera)

    cameras = tuple(map(turned, small_scene.recording.cameras, (0.9, -0.9, 0.9)))
    wrong = replace(small_scene.recording, cameras=cameras)
    (left_out,) = run_stages(wrong, HALF_SECOND).calibration.uncalibrated
    assert left_out.rejection.reason is RejectionReason.BONES_DISAGREE
