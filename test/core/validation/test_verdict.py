"""Status and message: what counts first, and what is said of rivals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stcalib_ros.core.bundle.covariance import pose_covariance
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.integration.exclusions import Exclusions
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.validation.camera_checks import check_cameras
from stcalib_ros.core.validation.verdict import Solution, judge, rivalry


@pytest.fixture(scope="module")
def solution(small_stages):
    last = small_stages.rounds[-1]
    covariance = pose_covariance(last.observations, last.state)
    views = small_stages.lifted, small_stages.skeleton
    found = check_cameras(*views, last, covariance, offset_range_s=0.5)
    names = tuple(camera.name for camera in small_stages.lifted)
    return Solution(small_stages.rounds, covariance, found, Exclusions(names, 0.5))


@pytest.fixture
def verdict(small_stages):
    def of(solution, doubt=""):
        return judge(small_stages.lifted, small_stages.skeleton, solution, doubt)

    return of


def doubtful(solution):
    worse = replace(solution.checks[1], bone_rotation=1.0)
    return replace(solution, checks=(solution.checks[0], worse, *solution.checks[2:]))


def test_a_sound_solution_is_good(solution, verdict):
    assert solution.sound
    status, message = verdict(solution)
    assert status is Status.OK
    assert message.startswith("3 of 3 cameras calibrated; least is known of cam")


def test_a_doubt_names_its_camera(solution, verdict):
    assert not doubtful(solution).sound
    status, message = verdict(doubtful(solution))
    assert status is Status.DEGENERATE
    assert message.startswith("cam1: the bones of its 3D poses disagree with its rotation")


def test_rivals_come_before_doubts_and_doubts_before_the_rest(solution, verdict):
    rivalled = replace(doubtful(solution), doubt="two of them")
    assert verdict(rivalled, "no metre")[1].startswith("two of them")
    assert verdict(doubtful(solution), "no metre")[1].startswith("cam1: ")
    assert verdict(solution, "no metre") == (Status.DEGENERATE, "no metre")


def test_what_still_moves_has_not_converged(solution, verdict):
    last = solution.last
    R = last.rig.R_ref_cam.copy()
    R[1] = R[1] @ exp_so3(np.array([0.0, 0.3, 0.0]))
    turned = replace(last, rig=replace(last.rig, R_ref_cam=R))
    status, message = verdict(replace(solution, iterations=(turned, last)))
    assert status is Status.NOT_CONVERGED
    assert "raise bundle.rounds" in message


@pytest.mark.parametrize(
    ("late_s", "says"), [(0.5, r"clocks differ by 15.0 frames \(0.50 s\)"), (0.0, "poses differ")]
)
def test_rivals_differ_by_clock_or_pose(solution, late_s, says):
    last = solution.last
    offset_s = last.rig.offset_s + np.array([0.0, late_s, 0.0])
    other = replace(last, rig=replace(last.rig, offset_s=offset_s))
    with pytest.raises(ValueError, match=says):
        raise ValueError(rivalry(last, other, offset_range_s=2.0))
