"""From the last round to what is published."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import HALF_SECOND, every
from exclusion_helpers import left_out

from stcalib_ros.core.bundle.covariance import PARAMETERS, pose_covariance
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.model.rejection import Rejection
from stcalib_ros.core.model.rejection import RejectionReason as R
from stcalib_ros.core.model.rejection_text import labelled
from stcalib_ros.core.options import Options
from stcalib_ros.core.output.assemble import failed_calibration, make_calibration
from stcalib_ros.core.output.world_frame import place
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.validation.verdict import Judgement


@pytest.fixture(scope="module")
def stages(small_scene):
    """The last camera is the reference."""
    return run_stages(small_scene.recording, replace(HALF_SECOND, reference="cam2"))


@pytest.fixture(scope="module")
def result(stages):
    return stages.calibration


def test_cameras_are_in_the_order_of_the_recording(result, small_scene):
    assert [c.name for c in result.cameras] == ["cam0", "cam1", "cam2"]
    assert result.reference == "cam2"
    for camera, recorded in zip(result.cameras, small_scene.recording.cameras, strict=True):
        assert camera.frame_id == recorded.frame_id
        assert camera.intrinsics is recorded.intrinsics


def test_the_reference_is_exactly_the_identity(result):
    reference = result.cameras[2]
    np.testing.assert_array_equal(reference.R_ref_cam, np.eye(3))
    assert not reference.t_ref_cam.any()
    assert reference.time_offset_s == reference.time_offset_stddev_s == 0
    assert not reference.covariance.any()


def test_rotations_are_rotations(result):
    for camera in result.cameras:
        np.testing.assert_allclose(camera.R_ref_cam @ camera.R_ref_cam.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(camera.R_ref_cam) == pytest.approx(1)


def test_blocks_of_the_joint_covariance_are_those_of_the_cameras(result):
    P = result.joint_covariance
    assert P.shape == (21, 21)
    assert result.parameter_order == tuple(
        f"{name}.{parameter}" for name in ("cam0", "cam1", "cam2") for parameter in PARAMETERS
    )
    for k, camera in enumerate(result.cameras):
        block = P[7 * k : 7 * k + 7, 7 * k : 7 * k + 7]
        np.testing.assert_array_equal(camera.covariance, block[:6, :6])
        assert camera.time_offset_stddev_s == pytest.approx(np.sqrt(block[6, 6]))


def made(stages, recording, **changes):
    last = stages.iterations[-1]
    covariance = pose_covariance(last.observations, last.state)
    parts = recording, stages.lifted, stages.skeleton, last, covariance
    return make_calibration(
        *parts,
        place(*parts, Options()),
        **{"judgement": Judgement(Status.OK), "uncalibrated": ()} | changes,
    )


def test_without_metres_the_unit_is_the_distance_of_the_first_two(stages, small_scene):
    unscaled = every(small_scene.recording, lambda c: replace(c, metric=False))
    metric, plain = made(stages, small_scene.recording), made(stages, unscaled)
    assert metric.metric
    assert not plain.metric
    apart = plain.cameras[1].t_ref_cam - plain.cameras[0].t_ref_cam
    assert np.linalg.norm(apart) == pytest.approx(1)
    first, second = metric.cameras[:2]
    factor = np.linalg.norm(second.t_ref_cam - first.t_ref_cam)
    for a, b in zip(metric.cameras, plain.cameras, strict=True):
        np.testing.assert_allclose(a.t_ref_cam, factor * b.t_ref_cam, atol=1e-9)
        np.testing.assert_array_equal(a.R_ref_cam, b.R_ref_cam)
        grow = np.array([factor] * 3 + [1.0] * 3)
        np.testing.assert_allclose(a.covariance, b.covariance * np.outer(grow, grow), rtol=1e-9)
        assert a.time_offset_stddev_s == b.time_offset_stddev_s


def test_one_camera_without_metres_is_enough_to_have_none(stages, small_scene):
    cameras = small_scene.recording.cameras
    mixed = replace(
        small_scene.recording, cameras=(*cameras[:2], replace(cameras[2], metric=False))
    )
    assert not made(stages, mixed).metric


def test_times_are_since_the_epoch_of_unix(result, small_scene):
    epoch_s = small_scene.recording.epoch_ns * 1e-9
    assert result.epoch_s == epoch_s
    offset = {c.name: c.time_offset_s for c in result.cameras}
    spans = [
        camera.stamps[[0, -1]] + offset[camera.name] for camera in small_scene.recording.cameras
    ]
    np.testing.assert_allclose(
        np.subtract(result.window_s, epoch_s),
        [min(s[0] for s in spans), max(s[1] for s in spans)],
        atol=1e-6,
    )


def test_a_camera_of_another_epoch_does_not_move_that_of_the_others(small_scene):
    """As if it stamped with the time since boot: decades before the others."""
    cameras = small_scene.recording.cameras
    later = replace(
        small_scene.recording,
        cameras=(
            *(replace(c, stamps=c.stamps + 1.7599e9) for c in cameras[:2]),
            replace(cameras[2], stamps=cameras[2].stamps + 100.0),
        ),
    )
    found = run_stages(later, replace(HALF_SECOND, align="stamps")).calibration
    alone = run_stages(replace(small_scene.recording, cameras=cameras[:2]), HALF_SECOND).calibration
    assert [one.name for one in found.uncalibrated] == ["cam2"]
    assert found.epoch_s - alone.epoch_s == pytest.approx(1.7599e9)
    for mine, its in zip(found.cameras, alone.cameras, strict=True):
        assert mine.time_offset_s == pytest.approx(its.time_offset_s, abs=1e-5)
        assert mine.time_offset_stddev_s == pytest.approx(its.time_offset_stddev_s, rel=0.01)


def test_persons_are_numbered_and_have_their_tracks(result, small_scene):
    assert [p.person_id for p in result.persons] == [0, 1]
    for person in result.persons:
        assert set(person.tracks) == {"cam0", "cam1", "cam2"}
        true = {
            int(small_scene.track_persons[name][i][0])
            for name, ids in person.tracks.items()
            for i in ids
        }
        assert len(true) == 1
        assert 2 < person.reprojection_rms_px < 4.5
        assert person.margin > 5


def test_counts_are_of_image_points(result, stages):
    last = stages.iterations[-1]
    assert result.n_observations == last.observations.observed.sum()
    assert 0.9 * result.n_observations < result.n_inliers <= result.n_observations


def test_status_message_and_what_is_missing_are_handed_on(stages, small_scene):
    missing = (left_out("cam9", "it is upside down"),)
    calibration = made(
        stages,
        small_scene.recording,
        judgement=Judgement(Status.DEGENERATE, (Rejection(R.UNSPECIFIED, detail="not good"),)),
        uncalibrated=missing,
    )
    assert calibration.status is Status.DEGENERATE
    assert calibration.message == "not good; cam9: it is upside down"
    assert calibration.uncalibrated == missing


def test_nothing_says_why_and_claims_nothing(small_scene):
    missing = (left_out("cam1", "it sleeps"),)
    calibration = failed_calibration(
        small_scene.recording,
        status=Status.INSUFFICIENT_DATA,
        rejections=(Rejection(R.NO_MOTION),),
        uncalibrated=missing,
    )
    assert calibration.status is Status.INSUFFICIENT_DATA
    assert calibration.cameras == calibration.persons == calibration.pairs == ()
    assert calibration.uncalibrated == missing
    assert calibration.n_inliers == 0
    stamps = np.concatenate([c.stamps for c in small_scene.recording.cameras])
    np.testing.assert_allclose(
        np.subtract(calibration.window_s, calibration.epoch_s),
        [stamps.min(), stamps.max()],
        atol=1e-6,
    )


def test_the_message_of_a_failure_of_the_whole_does_not_go_into_cameras(small_scene):
    whole, camera = Rejection(R.RIVAL_SOLUTION), Rejection(R.LOOKALIKES, ("cam1",))
    line = Rejection(R.COLLINEAR_MOTION)

    def message(*rejections):
        return failed_calibration(small_scene.recording, Status.DEGENERATE, rejections).message

    assert message(camera, line) == f"{labelled(camera)}; {labelled(line)}"
    assert message(whole, camera, line) == f"{labelled(whole)}; {labelled(line)}"


def test_nothing_of_nothing():
    calibration = failed_calibration(
        Recording(()), status=Status.CANCELLED, rejections=(Rejection(R.CANCELLED, detail="x"),)
    )
    assert calibration.reference == ""
    assert calibration.window_s == (0.0, 0.0)
