"""Metres and an upright frame, through the whole calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import HALF_SECOND, error, every

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.so3 import exp_so3, log_so3
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.recording import keypoints_only
from stcalib_ros.core.model.rejection import RejectionReason, RemarkCode
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.model.scale_cues import Distance
from stcalib_ros.core.options import ScaleOptions
from stcalib_ros.core.output.gravity import GravityFrame, heading_axis
from stcalib_ros.core.output.world_frame import WorldAlignment
from stcalib_ros.core.pipeline import calibrate, run_stages


def with_scale(**scale):
    return replace(HALF_SECOND, scale=ScaleOptions(**scale))


@pytest.fixture(scope="module")
def plain(small_scene):
    """Nobody claims metres."""
    return every(small_scene.recording, lambda c: replace(c, metric=False))


def baseline(scene, a, b):
    cameras = {c.name: c for c in scene.truth.cameras}
    return float(np.linalg.norm(cameras[a].t_ref_cam - cameras[b].t_ref_cam))


def test_a_known_distance_makes_it_metric(plain, small_scene):
    metres = baseline(small_scene, "cam1", "cam2")
    distance = Distance(metres, 0.005 * metres, cameras=("cam1", "cam2"))
    result = calibrate(plain, with_scale(distances=(distance,)))
    assert result.metric
    assert 0.005 <= result.scale_stddev < 0.01
    assert error(result, small_scene.truth).scale == pytest.approx(1.0, abs=0.01)


def test_the_height_of_people_makes_it_metric(plain, small_scene):
    result = calibrate(plain, with_scale(body_height_m=1.72))
    assert result.metric
    assert 0.04 < result.scale_stddev < 0.08
    scale = error(result, small_scene.truth).scale
    assert abs(np.log(scale)) < 3 * result.scale_stddev


def test_metric_poses_count_as_far_as_they_are_trusted(small_scene):
    result = calibrate(small_scene.recording, HALF_SECOND)
    assert result.scale_stddev == pytest.approx(0.1)
    metres = 1.1 * baseline(small_scene, "cam0", "cam1")
    distance = Distance(metres, 0.001 * metres, cameras=("cam0", "cam1"))
    sure = calibrate(small_scene.recording, with_scale(distances=(distance,)))
    assert error(sure, small_scene.truth).scale == pytest.approx(1.1, abs=0.002)


def test_cameras_without_3d_poses_claim_no_metres(small_scene, plain):
    """Their flag means nothing; that of a camera with 3D poses does."""
    flat = keypoints_only(plain, ["cam1"])
    claimed = [
        calibrate(every(flat, lambda c, m=metric: replace(c, metric=c.name in m)), HALF_SECOND)
        for metric in (("cam1",), ("cam0", "cam1"), ("cam0", "cam2"))
    ]
    assert [result.metric for result in claimed] == [False, False, True]


def test_metric_poses_that_contradict_what_was_measured_are_not_believed(small_scene):
    metres = 1.2 * baseline(small_scene, "cam0", "cam1")
    distance = Distance(metres, 0.001 * metres, cameras=("cam0", "cam1"))
    result = calibrate(small_scene.recording, with_scale(distances=(distance,), poses_sigma=0.01))
    assert result.status is Status.OK
    assert error(result, small_scene.truth).scale == pytest.approx(1.2, rel=0.01)


@pytest.mark.parametrize("factor", [3.4, 0.5])
def test_a_distance_that_contradicts_the_size_of_people_is_refused(small_scene, factor):
    """Also where 3D poses that are metric, and then not believed, say the same."""
    metres = factor * baseline(small_scene, "cam0", "cam1")
    distance = Distance(metres, 0.001 * metres, cameras=("cam0", "cam1"))
    result = calibrate(small_scene.recording, with_scale(distances=(distance,)))
    assert result.status is Status.DEGENERATE
    (inconsistent,) = result.rejections
    assert inconsistent.reason is RejectionReason.INCONSISTENT_SCALE
    assert "times as large as adults" in inconsistent.detail


def test_people_of_unusual_size_are_remarked_on(plain, small_scene):
    metres = 1.22 * baseline(small_scene, "cam0", "cam1")
    distance = Distance(metres, 0.001 * metres, cameras=("cam0", "cam1"))
    result = calibrate(plain, with_scale(distances=(distance,)))
    assert result.status is Status.OK
    codes = [remark.code for remark in result.remarks]
    assert RemarkCode.PEOPLE_OF_UNUSUAL_SIZE in codes


def test_children_whose_height_is_given_may_be_small(plain, small_scene):
    metres = 0.6 * baseline(small_scene, "cam0", "cam1")
    distance = Distance(metres, 0.01 * metres, cameras=("cam0", "cam1"))
    result = calibrate(plain, with_scale(distances=(distance,), body_height_m=1.72 * 0.6))
    assert result.status is Status.OK
    assert error(result, small_scene.truth).scale == pytest.approx(0.6, rel=0.05)


def test_measurements_that_contradict_each_other_are_refused(plain):
    distances = tuple(
        Distance(metres, 0.01, cameras=("cam0", name))
        for name, metres in (("cam1", 1), ("cam2", 99))
    )
    stages = run_stages(plain, with_scale(distances=distances))
    assert stages.calibration.status is Status.DEGENERATE
    (inconsistent,) = stages.calibration.rejections
    assert inconsistent.reason is RejectionReason.INCONSISTENT_SCALE
    assert "contradict each other" in inconsistent.detail
    assert stages.calibration.cameras


def test_an_unknown_camera_is_refused_at_once(plain):
    distance = Distance(1.0, 0.01, cameras=("cam0", "cam7"))
    with pytest.raises(InputError, match="'cam7' is not in the recording"):
        calibrate(plain, with_scale(distances=(distance,)))


def test_an_upright_frame_is_that_of_the_world(small_scene):
    options = replace(HALF_SECOND, world_frame="hall")
    result = calibrate(small_scene.recording, options)
    rig = small_scene.rig
    assert result.frame_id == result.reference_frame == "hall"
    for camera, R_cam_world, centre in zip(
        result.cameras, rig.R_cam_world, rig.centres_world, strict=True
    ):
        lean = log_so3(camera.R_ref_cam @ R_cam_world)[:2]
        assert np.degrees(np.linalg.norm(lean)) < 8.0
        assert camera.t_ref_cam[2] == pytest.approx(centre[2], abs=0.5)
    first = result.cameras[0]
    np.testing.assert_allclose(first.t_ref_cam[:2], 0.0, atol=1e-9)
    assert first.R_ref_cam[0, 2] > 0
    assert first.R_ref_cam[1, 2] == pytest.approx(0.0, abs=1e-9)
    assert np.diag(first.covariance)[[2, 3, 4]].min() > 0
    assert first.covariance[0, 0] == first.covariance[1, 1] == 0


def test_the_frame_does_not_change_the_cameras_among_themselves(small_scene):
    level = calibrate(small_scene.recording, replace(HALF_SECOND, world_frame="hall"))
    plain = calibrate(small_scene.recording, HALF_SECOND)
    assert plain.reference_frame == "cam0_optical_frame"
    difference = error(level, plain)
    assert difference.E_R < 1e-9
    assert difference.E_t < 1e-9


def rotation_looking(pitch, roll=0.0):
    """R_world_ref of a camera that is pitched down from looking along x, and rolled."""
    level = np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]])
    return exp_so3(np.array([0, pitch, 0])) @ level @ exp_so3(np.array([0, 0, roll]))


DOWN = np.pi / 2


@pytest.mark.parametrize("pitch", [0.4, DOWN - 0.05, DOWN, DOWN + 0.05, -DOWN, -DOWN + 0.05])
def test_common_motion_is_that_of_the_frame(pitch):
    """Against finite differences: the same points in a frame that is tilted and lifted a little."""
    rng = np.random.default_rng(0)
    tilted = rotation_looking(pitch)
    rig = Rig(
        np.arange(3), exp_so3(rng.normal(size=(3, 3))), rng.normal(size=(3, 3)), np.zeros(3), 1
    )
    rig.R_ref_cam[0], rig.t_ref_cam[0] = np.eye(3), 0.0
    step = 1e-6

    def placed(wx, wy, dh):
        R = exp_so3(np.array([wx, wy, 0.0])) @ tilted
        c, s = (R @ heading_axis(R))[:2] / np.linalg.norm((R @ heading_axis(R))[:2])
        R = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ R
        return WorldAlignment(2.0, upright=GravityFrame(R, 1.5 + dh, np.eye(3)))

    base = placed(0, 0, 0)
    J = np.zeros((21, 3))
    for k in range(3):
        moved = placed(*(step * np.eye(3)[k]))
        for c in range(3):
            J[7 * c : 7 * c + 3, k] = (
                moved.to_result(rig.t_ref_cam[c]) - base.to_result(rig.t_ref_cam[c])
            ) / step
            J[7 * c + 3 : 7 * c + 6, k] = log_so3(moved.R @ base.R.T) / step
    np.testing.assert_allclose(base.covariance_of(rig, np.zeros((21, 21))), J @ J.T, atol=1e-4)


@pytest.mark.parametrize("pitch", [0.0, 1.3, DOWN - 1e-4, DOWN, DOWN + 1e-4, -DOWN])
def test_the_heading_is_never_much_less_certain_than_the_tilt(pitch):
    frame = GravityFrame(rotation_looking(pitch), 2.5, np.diag([1e-4, 1e-4, 1e-4]))
    rig = Rig(np.arange(2), np.tile(np.eye(3), (2, 1, 1)), np.eye(3)[:2], np.zeros(2), 1)
    covariance = WorldAlignment(1.0, upright=frame).covariance_of(rig, np.zeros((14, 14)))
    assert np.sqrt(covariance[5, 5]) < 5.0 * 1e-2


@pytest.mark.parametrize("pitch", [-1.5, -1.2, 0.0, 1.2, 1.5])
def test_a_camera_that_tips_over_keeps_its_heading(pitch):
    """Optical axis and image vertical are one heading for a camera without roll."""
    x, y, _ = rotation_looking(pitch) @ heading_axis(rotation_looking(pitch))
    assert x > 0.19
    assert y == pytest.approx(0.0, abs=1e-12)
