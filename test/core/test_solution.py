"""Cameras in which two solutions differ are left out, and the others calibrated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import HALF_SECOND
from scipy.spatial.transform import Rotation

from stcalib_ros.core import solution
from stcalib_ros.core.bundle.initialization import Start
from stcalib_ros.core.control import Control
from stcalib_ros.core.integration.exclusions import Exclusions
from stcalib_ros.core.lifting.views import LiftedViews
from stcalib_ros.core.model.rejection import Rejection, RejectionReason
from stcalib_ros.core.model.rig import sub_rig
from stcalib_ros.core.registration.resampling import common_grid
from stcalib_ros.core.solution import CalibrationProblem, adjust_rigs
from stcalib_ros.core.validation.inconsistencies import CameraFaults


@pytest.fixture(scope="module")
def problem(small_stages, small_scene):
    names = tuple(camera.name for camera in small_stages.lifted)
    views = LiftedViews(small_stages.skeleton, small_stages.lifted, small_scene.recording)
    return CalibrationProblem(
        views,
        views,
        (0, 1, 2),
        Exclusions(names, HALF_SECOND.offset_range_s),
        common_grid(small_stages.lifted),
        HALF_SECOND,
        Control(),
    )


@pytest.fixture
def first(small_stages):
    return small_stages.iterations[0]


def turned(iteration, cameras):
    """Another solution, in which some cameras look elsewhere."""
    R = iteration.rig.R_ref_cam.copy()
    for k, c in enumerate(cameras):
        R[c] = R[c] @ Rotation.from_euler("y", 40 + 30 * k, degrees=True).as_matrix()
    return replace(iteration, rig=replace(iteration.rig, R_ref_cam=R))


@pytest.fixture
def disputed(first, monkeypatch):
    """The first rigs that are looked at have a rival that differs in some cameras."""
    select = solution.select_initial_rig

    def dispute(cameras):
        calls = []

        def selected(rigs, adjust, exclusions, tick):
            calls.append([rig.cameras.tolist() for rig in rigs])
            if len(calls) == 1:
                return Start(first, exclusions), turned(first, cameras)
            return select(rigs, adjust, exclusions, tick)

        monkeypatch.setattr(solution, "select_initial_rig", selected)
        return calls

    return dispute


@pytest.mark.parametrize("camera", [1, 2])
def test_a_disputed_camera_is_left_out(problem, first, disputed, monkeypatch, camera):
    monkeypatch.setattr(solution, "resect", lambda *_: None)
    calls = disputed([camera])
    found = adjust_rigs(problem, [first.rig, sub_rig(first.rig, [0, camera])], problem.exclusions)
    rest = [c for c in (0, 1, 2) if c != camera]
    # Of a rig of the reference and the disputed camera nothing is left.
    assert calls == [[[0, 1, 2], [0, camera]], [rest]]
    assert found.last.rig.cameras.tolist() == rest
    assert found.rival is None
    (excluded,) = found.exclusions.cameras
    assert excluded.name == f"cam{camera}"
    assert excluded.rejection.reason is RejectionReason.RIVAL_SOLUTION
    assert excluded.rejection.cameras == (f"cam{camera}",)


def test_what_is_wrong_with_its_input_is_said_where_its_residuals_say(
    problem, first, disputed, monkeypatch
):
    fault = Rejection(RejectionReason.CLOCK_NOT_STEADY, measured=0.1, limit=0.01, unit="s")

    def inconsistencies(_cameras, _skeleton, last):
        return tuple(CameraFaults((fault,) if c == 2 else ()) for c in last.rig.cameras)

    monkeypatch.setattr(solution, "inconsistencies", inconsistencies)
    disputed([2])
    found = adjust_rigs(problem, [first.rig], problem.exclusions)
    (left_out,) = found.exclusions.cameras
    assert (left_out.name, left_out.rejection.reason) == ("cam2", fault.reason)
    assert left_out.rejection.cameras == ("cam2",)


def test_where_it_is_the_reference_the_next_camera_is_it(problem, first, disputed, monkeypatch):
    monkeypatch.setattr(solution, "resect", lambda *_: None)
    disputed([0])
    found = adjust_rigs(problem, [first.rig], problem.exclusions)
    assert found.last.rig.cameras.tolist() == [1, 2]
    np.testing.assert_allclose(found.last.rig.R_ref_cam[0], np.eye(3), atol=1e-9)
    assert [one.name for one in found.exclusions.cameras] == ["cam0"]


def test_it_comes_back_if_the_people_say_where_it_is(problem, first, disputed):
    disputed([2])
    found = adjust_rigs(problem, [first.rig], problem.exclusions)
    assert found.last.rig.cameras.tolist() == [0, 1, 2]
    assert found.exclusions.cameras == ()
    assert found.rival is None


def test_where_fewer_than_two_cameras_would_be_left_the_rival_stays(problem, first, disputed):
    disputed([1, 2])
    found = adjust_rigs(problem, [first.rig], problem.exclusions)
    assert found.last.rig.cameras.tolist() == [0, 1, 2]
    assert found.exclusions.cameras == ()
    assert found.rival.reason is RejectionReason.RIVAL_SOLUTION


def test_without_a_rival_nobody_is_left_out(problem, first):
    found = adjust_rigs(problem, [first.rig], problem.exclusions)
    assert found.last.rig.cameras.tolist() == [0, 1, 2]
    assert found.rival is None
    assert found.exclusions.cameras == ()
