"""What a calibration rests on, and the complaints about it."""

from __future__ import annotations

from dataclasses import replace

import pytest
from core_helpers import HALF_SECOND, SOUND, every, tracks_changed

from stcalib_ros.core.bundle.covariance import pose_covariance
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.validation.camera_checks import check_cameras


def test_sound_evidence_gives_no_complaint():
    assert SOUND.complaint() is None
    assert replace(SOUND, shared_s=1.0).complaint() is None
    assert replace(SOUND, explained=0.2).complaint() is None


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"inliers": 150}, "only 150 of its image points fit, 400 are needed"),
        ({"inlier_share": 0.3}, "only 30 % of its image points fit: check its intrinsics"),
        (
            {"shared_s": 1.3, "explained": 0.6},
            "only 1.3 s of somebody's motion with the others, and only 60 % .* may be chance",
        ),
        ({"explained": 0.2, "rotation_stddev": 0.01}, "only 20 % of all that it sees agrees"),
        ({"explained": 0.2, "offset_contrast": 1.9}, "only 20 % of all that it sees agrees"),
        ({"bone_rotation": 1.0}, "disagree with its rotation by 57 degrees"),
        ({"bone_rotation": float("nan")}, "disagree with its rotation"),
        ({"depth_ratio": 1.7}, "people would be 1.7 times as far"),
        ({"depth_ratio": 0.5}, "people would be 0.5 times as far"),
        ({"depth_ratio": float("nan")}, "people would be nan times"),
        ({"rotation_stddev": 0.05}, "rotation is uncertain by 2.9 degrees"),
        ({"rotation_stddev": float("nan")}, "rotation is uncertain"),
        ({"centre_stddev": 0.2}, "position is uncertain by 20 % of its distance"),
        ({"offset_contrast": 1.05}, "cannot be told: one that is 0.40 s away .* 1.05 times"),
        ({"offset_contrast": float("nan")}, "clock offset cannot be told"),
        ({"offset_stddev_frames": 2.5}, "clock offset is uncertain by 2.5 frames"),
        ({"offset_stddev_frames": float("inf")}, "clock offset is uncertain by inf frames"),
        (
            {"inlier_share": 0.75, "contrast_with_outliers": 1.02},
            "only 75 % of its image points fit, and with another clock offset all of them",
        ),
        ({"doubled": True}, "everybody whom it sees moves like somebody else at another place"),
    ],
)
def test_every_weakness_is_said_with_its_number(change, says):
    complaint = replace(SOUND, **change).complaint()
    assert complaint is not None
    with pytest.raises(ValueError, match=says):
        raise ValueError(complaint)
    assert "\n" not in complaint


@pytest.fixture(scope="module")
def last(small_stages):
    return small_stages.rounds[-1]


def evidence_of(stages, last):
    covariance = pose_covariance(last.observations, last.state)
    return check_cameras(stages.lifted, stages.skeleton, last, covariance, offset_range_s=0.5)


def test_the_evidence_of_a_good_calibration_is_sound(small_stages, last):
    for one in evidence_of(small_stages, last):
        assert one.complaint() is None
        assert one.inlier_share > 0.9
        # Lifters of 30 to 60 mm and a size prior of 4 %.
        assert one.bone_rotation < 0.1
        assert one.depth_ratio == pytest.approx(1, abs=0.1)


def test_poses_of_another_person_are_noticed(small_scene):
    def mirrored(track):
        return replace(track, joints=track.joints * [1.0, 1.0, -1.0])

    wrong = every(small_scene.recording, tracks_changed(mirrored))
    calibration = run_stages(wrong, HALF_SECOND).calibration
    assert calibration.status != 0
