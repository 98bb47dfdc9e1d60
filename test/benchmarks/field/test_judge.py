"""What counts as wrong, as named, and as right for one side."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.field.__main__ import MEMBERS
from benchmarks.field.case import CODES as CODES_OF_KINDS
from benchmarks.field.case import NAMED, Answer, Case, simulated
from benchmarks.field.changes import turned, with_stamps
from benchmarks.field.judge import Finding
from benchmarks.field.judge import judge as judge_by_codes
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.calibration import Calibration, Status, UncalibratedCamera
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark, RemarkCode
from stcalib_ros.core.synthetic import SceneOptions


@pytest.fixture(scope="module")
def case() -> Case:
    return simulated(SceneOptions(n_cameras=3, n_people=1, n_frames=60, seed=5))


CODES = {"DISCONNECTED", "BONES_DISAGREE", "POSES_LEFT_OUT"}


def judge(case: Case, found: Calibration) -> Finding:
    return judge_by_codes(case, found, CODES)


def _said(truth: Calibration) -> Calibration:
    """The truth as a calibration would say it, with deviations of .001 rad."""
    cameras = tuple(replace(c, covariance=1e-6 * np.eye(6)) for c in truth.cameras)
    return replace(truth, cameras=cameras, remarks=())


def test_the_truth_is_good_and_a_turned_camera_or_a_clock_off_by_a_frame_is_wrong(case):
    said = _said(case.truths[0])
    assert judge(case, said).answer is Answer.GOOD

    first, second, third = said.cameras
    off = replace(second, R_ref_cam=second.R_ref_cam @ exp_so3(np.array([0.03, 0.0, 0.0])))
    assert judge(case, replace(said, cameras=(first, off, third))).answer is Answer.WRONG

    late = replace(second, time_offset_s=second.time_offset_s + 0.03)
    assert judge(case, replace(said, cameras=(first, late, third))).answer is Answer.WRONG


def test_an_error_of_many_deviations_is_wrong_though_it_is_small(case):
    said = _said(case.truths[0])
    first, second, third = said.cameras
    off = replace(
        second,
        R_ref_cam=second.R_ref_cam @ exp_so3(np.array([0.01, 0.0, 0.0])),
        covariance=1e-8 * np.eye(6),
    )
    found = judge(case, replace(said, cameras=(first, off, third)))
    assert found.answer is Answer.WRONG
    assert found.deviations == pytest.approx(100.0, rel=0.01)


def test_a_camera_that_is_left_out_has_to_be_the_one_that_is_faulty(case):
    said = _said(case.truths[0])
    stepped = with_stamps(case, "cam1", case.camera("cam1").stamps.copy())
    for name, answer in (("cam1", Answer.LEFT_OUT), ("cam2", Answer.UNNAMED)):
        why = UncalibratedCamera(name, Rejection(RejectionReason.DISCONNECTED, (name,)))
        rest = tuple(c for c in said.cameras if c.name != name)
        assert judge(stepped, replace(said, cameras=rest, uncalibrated=(why,))).answer is answer


def test_a_refusal_has_to_name_the_camera_that_is_faulty(case):
    faulty = with_stamps(case, "cam1", case.camera("cam1").stamps.copy())
    for name, answer in (("cam1", Answer.REFUSED), ("cam2", Answer.UNNAMED)):
        why = Rejection(RejectionReason.BONES_DISAGREE, (name,), 1.0, 0.3, "rad")
        refused = replace(case.truths[0], status=Status.DEGENERATE, rejections=(why,))
        assert judge(faulty, refused).answer is answer


def test_another_reason_does_not_name_what_is_wrong(case):
    faulty = with_stamps(case, "cam1", case.camera("cam1").stamps.copy())
    why = Rejection(RejectionReason.LIMBS_DISAGREE, ("cam1",), 0.2, 0.1)
    refused = replace(case.truths[0], status=Status.DEGENERATE, rejections=(why,))
    assert judge(faulty, refused).answer is Answer.UNNAMED
    assert judge_by_codes(faulty, refused, {"LIMBS_DISAGREE"}).answer is Answer.REFUSED


def test_after_a_step_one_side_is_right_if_that_is_said(case):
    stamps = case.camera("cam1").stamps.copy()
    stamps[30:] += 0.1
    stepped = with_stamps(case, "cam1", stamps)
    said = _said(case.truths[0])
    assert judge(stepped, said).answer is Answer.WRONG
    remark = Remark(RemarkCode.POSES_LEFT_OUT, ("cam1",))
    assert judge(stepped, replace(said, remarks=(remark,))).answer is Answer.ONE_SIDE


@pytest.mark.parametrize("name", ["cam0", "cam1"])
def test_either_pose_of_a_camera_that_was_turned_is_true(case, name):
    moved = turned(case, name, 30, np.array([0.0, 0.1, 0.0]))
    remark = Remark(RemarkCode.POSES_LEFT_OUT, (name,))
    for truth in moved.truths:
        said = _said(truth)
        assert judge(moved, replace(said, remarks=(remark,))).answer is Answer.ONE_SIDE
        assert judge(moved, said).answer is Answer.WRONG


def test_turned_keypoints_are_those_of_the_turned_camera(case):
    turn = np.array([0.02, 0.05, -0.03])
    moved = turned(case, "cam1", 0, turn)
    track = moved.camera("cam1").tracks[0]
    before, K = case.camera("cam1").tracks[0], case.camera("cam1").intrinsics.K
    R_new_old = exp_so3(-turn)
    expected = before.joints @ R_new_old.T
    np.testing.assert_allclose(track.joints, expected, atol=1e-6)
    rays = np.concatenate([before.keypoints, np.ones((*before.keypoints.shape[:2], 1))], -1)
    x = rays @ np.linalg.inv(K).T @ R_new_old.T @ K.T
    pixels = x[..., :2] / x[..., 2:]
    inside = ((pixels > 0) & (pixels < [1920, 1080])).all(-1)
    np.testing.assert_allclose(track.keypoints[inside], pixels[inside], atol=1e-6)
    assert np.isnan(track.keypoints[~inside]).all()


def test_there_are_forty_members_and_more_of_every_kind():
    assert len(MEMBERS) >= 40
    assert {member.kind for member in MEMBERS} >= set("ABCDEFGH")
    assert len({member.name for member in MEMBERS}) == len(MEMBERS)
    known = {code.value for code in (*RejectionReason, *RemarkCode)}
    assert set().union(*CODES_OF_KINDS.values()) <= known
    assert all(Answer.WRONG not in member.right and member.right <= NAMED for member in MEMBERS)
