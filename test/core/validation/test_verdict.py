"""Status and reasons: what counts first, and how rivals differ."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import HALF_SECOND

from stcalib_ros.core.bundle.covariance import pose_covariance
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.integration.exclusions import Exclusions
from stcalib_ros.core.lifting.views import LiftedViews, lift_views
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.recording import keypoints_only
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, RemarkCode
from stcalib_ros.core.options import Options
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.refinement.sequence import refine
from stcalib_ros.core.validation.camera_checks import check_cameras
from stcalib_ros.core.validation.verdict import (
    Solution,
    judge,
    rival_solution,
    unsettled_cameras,
)


@pytest.fixture(scope="module")
def solution(small_stages, small_scene):
    last = small_stages.iterations[-1]
    covariance = pose_covariance(last.observations, last.state)
    lifted, skeleton = small_stages.lifted, small_stages.skeleton
    found = check_cameras(lifted, skeleton, last, covariance, offset_range_s=0.5)
    names = tuple(camera.name for camera in lifted)
    views = LiftedViews(small_stages.skeleton, small_stages.lifted, small_scene.recording)
    exclusions = Exclusions(names, 0.5)
    return Solution(views, small_stages.iterations, covariance, found, exclusions, unsettled=0)


@pytest.fixture
def verdict(small_stages):
    def of(solution, misaligned=None):
        return judge(small_stages.lifted, small_stages.skeleton, solution, misaligned)

    return of


NO_METRE = Rejection(RejectionReason.INCONSISTENT_SCALE, detail="no metre")


def failing(solution):
    worse = replace(solution.checks[1], bone_rotation=1.0)
    return replace(solution, checks=(solution.checks[0], worse, *solution.checks[2:]))


def codes(verdict):
    return [rejection.reason for rejection in verdict.rejections]


def test_a_sound_solution_is_good(solution, verdict):
    assert solution.sound
    found = verdict(solution)
    assert found.status is Status.OK
    assert found.rejections == ()
    assert found.remarks[0].code is RemarkCode.LEAST_CONSTRAINED_CAMERA


def test_keypoints_alone_are_enough_and_that_is_said(solution, verdict, small_scene, small_stages):
    bare = lift_views(keypoints_only(small_scene.recording), Options()).lifted
    found = check_cameras(
        bare,
        small_stages.skeleton,
        solution.last,
        solution.covariance,
        offset_range_s=0.5,
    )
    assert all(np.isnan(one.bone_rotation) for one in found)
    judged = verdict(replace(solution, checks=found))
    assert judged.status is Status.OK
    assert judged.remarks[-1].code is RemarkCode.VERIFIED_BY_LIMBS_ALONE
    assert judged.remarks[-1].cameras == ("cam0", "cam1", "cam2")


def test_a_rejected_camera_is_named(solution, verdict):
    assert not failing(solution).sound
    found = verdict(failing(solution))
    assert found.status is Status.DEGENERATE
    assert codes(found) == [RejectionReason.BONES_DISAGREE]
    assert found.rejections[0].cameras == ("cam1",)
    assert found.remarks == ()


def test_rivals_come_before_cameras_and_cameras_before_the_rest(solution, verdict):
    rival = Rejection(RejectionReason.RIVAL_SOLUTION)
    found = verdict(replace(failing(solution), rival=rival), NO_METRE)
    assert codes(found) == [
        RejectionReason.RIVAL_SOLUTION,
        RejectionReason.BONES_DISAGREE,
        RejectionReason.INCONSISTENT_SCALE,
    ]
    assert verdict(solution, NO_METRE).status is Status.DEGENERATE


def turned(iteration):
    R = iteration.rig.R_ref_cam.copy()
    R[1] = R[1] @ exp_so3(np.array([0.0, 0.3, 0.0]))
    return replace(iteration, rig=replace(iteration.rig, R_ref_cam=R))


def test_keypoints_that_count_as_fitting_and_are_far_off_are_not_good(solution, verdict):
    """One in twenty, by 0.05 of the distance: 70 px."""
    last = solution.last
    x = last.observations.x.copy()
    x[::20] += 0.05
    off = replace(last, observations=replace(last.observations, x=x))
    found = verdict(replace(solution, iterations=(*solution.iterations[:-1], off)))
    assert found.status is Status.DEGENERATE
    assert codes(found)[0] is RejectionReason.LARGE_RESIDUALS
    assert found.rejections[0].measured > 10.0


def test_what_still_moves_has_not_converged(solution, verdict):
    last = solution.last
    assert unsettled_cameras((last, last)) == unsettled_cameras((last,)) == 0
    unsettled = unsettled_cameras((turned(last), last))
    assert unsettled == 1
    found = verdict(replace(solution, unsettled=unsettled))
    assert found.status is Status.NOT_CONVERGED
    assert codes(found) == [RejectionReason.NOT_CONVERGED]
    assert found.rejections[0].measured == 1


def test_a_correction_by_the_refinement_does_not_count_as_unsettled(small_scene, monkeypatch):
    def correcting(*args, **kwargs):
        refined = refine(*args, **kwargs)
        *first, last = refined.iterations
        return replace(refined, iterations=(*first, turned(last), last))

    monkeypatch.setattr("stcalib_ros.core.solution.refine", correcting)
    assert calibrate(small_scene.recording, HALF_SECOND).status is Status.OK


@pytest.mark.parametrize(("late_s", "frames"), [(0.5, 15.0), (0.0, 0.0)])
def test_rivals_differ_by_clock_or_pose(solution, late_s, frames):
    last = solution.last
    offset_s = last.rig.offset_s + np.array([0.0, late_s, 0.0])
    other = replace(last, rig=replace(last.rig, offset_s=offset_s))
    found = rival_solution(last, other, offset_range_s=2.0)
    assert found.measured == pytest.approx(late_s)
    assert found.values["frames"] == pytest.approx(frames)
    assert found.values["offset_range_s"] == 2.0
