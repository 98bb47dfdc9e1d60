"""A camera that was left out, registered against the people whom the others see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import FRAME_S, HALF_SECOND, changed, clock_shifted, error

from stcalib_ros.core import solution
from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.pipeline import calibrate, run_stages
from stcalib_ros.core.reconstruction.resection import Resection, add_cameras, resect
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.mocap import shipped_clips

FOUR = SceneOptions(n_frames=100, n_people=2, id_switches_per_10s=0.3, seed=3)


@pytest.fixture(scope="module")
def four():
    return simulate(FOUR)


@pytest.fixture(scope="module")
def three(four):
    """Stages of a recording whose camera 1 nobody could place: its clock is an hour off."""
    late = changed(four.recording, "cam1", clock_shifted(3600.0))
    stages = run_stages(late, replace(HALF_SECOND, align="stamps"))
    assert [c.name for c in stages.calibration.cameras] == ["cam0", "cam2", "cam3"]
    return stages


def with_clock(stages, shift_s):
    """The lifted cameras, camera 1 with another clock."""
    cameras = list(stages.lifted)
    cameras[1] = replace(cameras[1], stamps=cameras[1].stamps + shift_s)
    return cameras


def again(stages, cameras, options=HALF_SECOND):
    return resect(cameras, 1, stages.skeleton, stages.iterations[-1], options)


@pytest.mark.parametrize("late_s", [-0.3, 0.0, 0.4])
def test_pose_and_offset_are_found(four, three, late_s):
    found = again(three, with_clock(three, late_s - 3600.0))
    assert found is not None
    true = four.truth.cameras[1]
    assert rotation_angle(found.R_ref_cam.T @ true.R_ref_cam) < 0.01
    # The unit is that of the round: the size of the people.
    np.testing.assert_allclose(found.t_ref_cam, true.t_ref_cam, rtol=0.1, atol=0.1)
    assert abs(found.offset_s + late_s - true.time_offset_s) < 0.3 * FRAME_S
    assert found.explained > 0.6


def test_an_offset_beyond_the_range_is_not_found(three):
    found = again(three, with_clock(three, 2.5 - 3600.0))
    assert found is None or found.explained < 0.4


def test_a_camera_that_watches_other_people_stays_out(three):
    strangers = simulate(replace(FOUR, seed=78)).recording.cameras[1]
    elsewhere = run_stages(simulate(replace(FOUR, seed=78)).recording, HALF_SECOND).lifted
    cameras = list(three.lifted)
    cameras[1] = elsewhere[1]
    assert cameras[1].name == strangers.name
    assert again(three, cameras) is None


def test_known_clocks_are_not_searched(four, three):
    true = four.truth.cameras[1].time_offset_s
    at_once = replace(HALF_SECOND, offset_range_s=0.0)
    found = again(three, with_clock(three, true - 3600.0), at_once)
    assert found is not None
    assert found.offset_s == 0.0


def test_the_first_camera_of_the_order_becomes_the_reference(three, four):
    found = again(three, with_clock(three, -3600.0))
    rig = add_cameras(three.lifted, three.iterations[-1].rig, {1: found}, [1, 0, 2, 3])
    assert rig.cameras.tolist() == [1, 0, 2, 3]
    np.testing.assert_allclose(rig.R_ref_cam[0], np.eye(3), atol=1e-12)
    assert not rig.t_ref_cam[0].any()
    assert rig.offset_s[0] == 0.0
    true = four.truth.cameras
    R_1_0 = true[1].R_ref_cam.T @ true[0].R_ref_cam
    assert rotation_angle(rig.R_ref_cam[1].T @ R_1_0) < 0.01


def test_a_camera_that_comes_back_has_its_own_lens(three):
    found = again(three, with_clock(three, -3600.0))
    lenses = [camera.intrinsics for camera in three.lifted]
    estimated = replace(three.iterations[-1].rig, lenses=(lenses[0], lenses[2], lenses[3]))
    rig = add_cameras(three.lifted, estimated, {1: found}, [0, 1, 2, 3])
    assert all(one is lens for one, lens in zip(rig.lenses, lenses, strict=True))


@pytest.mark.parametrize(
    ("change", "other"),
    [
        ({}, False),
        ({"offset_s": 2 * FRAME_S}, False),
        ({"offset_s": 4 * FRAME_S}, True),
        ({"t_ref_cam": np.array([0.0, 0.5, 0.0])}, True),
    ],
)
def test_solutions_differ_in_pose_or_clock(change, other):
    one = Resection(np.eye(3), np.zeros(3), 0.0, 0.5)
    assert one.differs(replace(one, **change), FRAME_S) is other


def test_a_camera_that_no_pair_could_place_comes_back():
    """None of its candidates has the true offset; with the others calibrated it is clear."""
    scene = simulate(SceneOptions(n_cameras=8, seed=1701), clips=shipped_clips())
    calibration = calibrate(scene.recording)
    e = error(calibration, scene.truth)
    assert calibration.status is Status.OK
    assert not calibration.uncalibrated
    assert max(abs(c.offset_frames) for c in e.cameras) < 0.1
    assert e.E_R < 0.001


def test_where_nobody_is_left_out_nothing_is_registered_again(small_scene, monkeypatch):
    def never(*args):
        raise AssertionError(args)

    monkeypatch.setattr(solution, "resect", never)
    assert calibrate(small_scene.recording, HALF_SECOND).status is Status.OK
