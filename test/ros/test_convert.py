"""Records to messages: nothing is lost, turned round or made up."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from rclpy.serialization import deserialize_message, serialize_message
from samples import LENS, STAMP, calibration, poses_message, result_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, RegionOfInterest
from stcalib_ros.msg import CalibrationResult, PersonPose3D, PersonPose3DArray

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.camera_info import intrinsics_from_camera_info
from stcalib_ros.core.model.lens_knowledge import LensKnowledge, LensStddev
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.io.messages import camera_info_fields, lens, pose_image
from stcalib_ros.ros.convert import (
    calibration_result,
    decode,
    message_class,
    time_message,
)


def through_cdr(message):
    return deserialize_message(serialize_message(message), type(message))


def test_poses_point_from_camera_to_reference():
    record, message = calibration(), through_cdr(result_message())
    assert message.header.frame_id == "cam1_optical_frame"
    for camera, extrinsics in zip(record.cameras, message.extrinsics, strict=True):
        pose, q = extrinsics.pose.pose, extrinsics.pose.pose.orientation
        np.testing.assert_allclose(
            Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix(), camera.R_ref_cam, atol=1e-12
        )
        p = pose.position
        np.testing.assert_array_equal([p.x, p.y, p.z], camera.t_ref_cam)
        np.testing.assert_array_equal(extrinsics.pose.covariance, camera.covariance.ravel())
        assert extrinsics.camera == camera.name
        assert extrinsics.child_frame_id == camera.frame_id
        assert extrinsics.header == message.header
        assert extrinsics.metric


def test_a_rotation_about_the_optical_axis_has_its_sign():
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # x to y
    record = calibration()
    turned = replace(record, cameras=(replace(record.cameras[0], R_ref_cam=quarter),))
    message = calibration_result(turned, run_id="", stamp=STAMP)
    q = message.extrinsics[0].pose.pose.orientation
    np.testing.assert_allclose([q.x, q.y, q.z, q.w], [0, 0, math.sqrt(0.5), math.sqrt(0.5)])


def test_clocks():
    record, message = calibration(), through_cdr(result_message())
    for camera, offset in zip(record.cameras, message.time_offsets, strict=True):
        assert (offset.camera, offset.reference) == (camera.name, "cam1")
        assert offset.offset_s == camera.time_offset_s
        assert offset.offset_stddev_s == camera.time_offset_stddev_s
        assert offset.skew == camera.clock_skew
        assert math.isnan(offset.skew_stddev)
        assert offset.line_time_s == camera.line_time_s > 0.0
        assert math.isnan(offset.line_time_stddev_s)
        assert (offset.epoch.sec, offset.epoch.nanosec) == (1_760_000_000, 250_000_000)
    assert message.time_offsets[0].offset_frames == record.cameras[0].time_offset_s * 30
    assert math.isnan(message.time_offsets[1].offset_frames)


def test_persons_pairs_and_figures():
    message = through_cdr(result_message())
    first, second = message.persons
    assert (first.person_id, list(first.cameras)) == (0, ["cam0", "cam1", "cam1"])
    assert list(first.track_ids) == [3, 7, 12]
    assert (first.reprojection_rms_px, first.margin) == (1.5, 4.0)
    assert math.isinf(second.margin)
    (pair,) = message.pairs
    assert (pair.camera_a, pair.camera_b, pair.n_matches) == ("cam0", "cam1", 2)
    assert (pair.median_angle_rad, pair.epipolar_rms_px) == (0.125, 1.75)
    assert (message.run_id, message.status) == ("run-1", CalibrationResult.OK)
    assert message.message == "3 cameras from 2 persons"
    assert message.reprojection_rms_px == 2.25
    assert (message.n_observations, message.n_inliers) == (5000, 4700)
    assert (message.window_start.sec, message.window_end.nanosec) == (1_760_000_000, 500_000_000)
    assert list(message.joint_covariance) == [0, 1, 2, 3]
    assert list(message.parameter_order) == ["cam0.x", "cam0.time_offset_s"]


def test_reasons_have_codes_numbers_and_sentences():
    lookalikes, few, left_out = through_cdr(result_message()).reasons
    assert (lookalikes.code, list(lookalikes.cameras)) == ("LOOKALIKES", ["cam1"])
    assert math.isnan(lookalikes.measured)
    assert math.isnan(lookalikes.limit)
    assert (few.code, few.measured, few.limit, few.unit) == (
        "TOO_FEW_INLIERS",
        150.0,
        400.0,
        "keypoints",
    )
    assert few.message.startswith("cam2: only 150 keypoints fit the other cameras")
    assert (left_out.code, left_out.message) == ("UNSPECIFIED", "shares nobody with the others")


def test_lenses_are_those_given_or_estimated():
    record = calibration()
    K = np.array([[812.5, 0.0, 318.0], [0.0, 812.5, 242.0], [0.0, 0.0, 1.0]])
    found = Intrinsics(640, 480, LensModel.PLUMB_BOB, K, np.array([-0.125]))
    stddev = LensStddev(2.5, 0.0, 1.5, (0.004,))
    estimated = replace(
        record.cameras[0],
        intrinsics=found,
        lens_knowledge=LensKnowledge.UNKNOWN,
        lens_stddev=stddev,
    )
    record = replace(record, cameras=(estimated, *record.cameras[1:]))
    message = through_cdr(calibration_result(record, run_id="", stamp=STAMP))
    first, second, _ = message.intrinsics
    assert [one.camera for one in message.intrinsics] == ["cam0", "cam1", "cam2"]
    assert (first.knowledge, second.knowledge) == ("unknown", "given")
    assert (first.focal_stddev_px, first.cy_stddev_px) == (2.5, 1.5)
    assert math.isnan(first.cx_stddev_px), "it was not estimated"
    assert list(first.radial_stddev) == [0.004]
    assert math.isnan(second.focal_stddev_px)
    info = first.camera_info
    assert (info.header.frame_id, info.header.stamp) == ("cam0_optical_frame", STAMP)
    assert list(info.d) == [-0.125, 0.0, 0.0, 0.0, 0.0], "as many as drivers expect"
    np.testing.assert_array_equal(np.reshape(info.p, (3, 4)), np.hstack([K, np.zeros((3, 1))]))
    again = lens(camera_info_fields(info), rectified=False, topic="/cam0/camera_info")
    np.testing.assert_array_equal(again.K, K)
    assert (again.width, again.height, again.model) == (640, 480, LensModel.PLUMB_BOB)


@pytest.mark.parametrize("status", Status)
def test_a_failure_has_its_status_and_no_made_up_numbers(status):
    failed = replace(
        calibration(),
        status=status,
        cameras=(),
        window_s=(math.nan, math.nan),
        reprojection_rms_px=math.nan,
    )
    message = calibration_result(failed, run_id="", stamp=STAMP)
    assert message.status == getattr(CalibrationResult, status.name)
    assert message.header.frame_id == ""
    assert math.isnan(message.reprojection_rms_px)
    assert (message.window_start.sec, message.window_start.nanosec) == (0, 0)


@pytest.mark.parametrize(
    ("stamp_s", "expected"),
    [
        (0.0, (0, 0)),
        (1.5, (1, 500_000_000)),
        (2.9999999999, (3, 0)),
        (math.nan, (0, 0)),
    ],
)
def test_time_message(stamp_s, expected):
    stamp = time_message(stamp_s)
    assert (stamp.sec, stamp.nanosec) == expected


@pytest.mark.parametrize("rectified", [False, True])
@pytest.mark.parametrize("model", LensModel)
def test_a_camera_info_gives_the_lens_of_its_numbers(model, rectified):
    d = [0.1, -0.05, 0.001, 0.002, 0.01, 0.2, 0.02, 0.003]
    d = d[: {"plumb_bob": 5, "rational_polynomial": 8, "equidistant": 4}[model.value]]
    numbers = {
        "width": 1280,
        "height": 720,
        "distortion_model": model.value,
        "d": d,
        "k": [900.0, 0.0, 640.0, 0.0, 900.0, 360.0, 0.0, 0.0, 1.0],
        "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "p": [850.0, 0.0, 630.0, 0.0, 0.0, 850.0, 350.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        "binning_x": 2,
        "binning_y": 4,
    }
    roi = RegionOfInterest(x_offset=40, y_offset=20, width=800, height=600)
    message = through_cdr(CameraInfo(**numbers, roi=roi))
    given = lens(camera_info_fields(message), rectified=rectified, topic="/cam0/camera_info")
    expected = intrinsics_from_camera_info(**numbers, roi=(40, 20, 800, 600), rectified=rectified)
    assert (given.width, given.height, given.model) == (400, 150, expected.model)
    np.testing.assert_array_equal(given.K, expected.K)
    np.testing.assert_array_equal(given.D, expected.D)
    np.testing.assert_array_equal(given.R_rect_cam, expected.R_rect_cam)


@pytest.mark.parametrize("rectified", [False, True])
def test_of_an_uncalibrated_camera_only_the_size_of_the_image_is_known(rectified):
    info = camera_info_fields(through_cdr(CameraInfo(width=LENS.width, height=LENS.height)))
    unknown = lens(info, rectified=rectified, topic="/cam7/camera_info")
    assert (unknown.known, unknown.width, unknown.height) == (False, LENS.width, LENS.height)


def test_poses_become_the_same_arrays():
    message = poses_message()
    data = serialize_message(message)
    image = pose_image(decode("stcalib_ros/msg/PersonPose3DArray", data), topic="/cam0/poses")
    (person,) = message.persons
    np.testing.assert_array_equal(image.keypoints.ravel(), np.array(person.keypoints))
    np.testing.assert_array_equal(image.joints.ravel(), np.array(person.joints))
    np.testing.assert_array_equal(image.joint_scores.ravel(), np.array(person.joint_scores))
    assert np.isnan(image.keypoints[0, 2]).all()
    assert image.stamp_ns == 1_760_000_100_000_000_007
    assert (image.track_ids.tolist(), image.scores.tolist()) == ([5], [0.75])
    assert (image.rectified, image.metric, image.layout.name) == (True, False, "h36m_17")


def test_poses_without_3d_have_none():
    message = poses_message()
    message.persons[0].joints = []
    data = serialize_message(message)
    image = pose_image(decode("stcalib_ros/msg/PersonPose3DArray", data), topic="/cam0/poses")
    assert image.joints is None
    np.testing.assert_array_equal(image.keypoints.ravel(), np.array(message.persons[0].keypoints))


def test_messages_are_empty_when_nothing_is_set():
    """No field starts as something that looks observed."""
    assert PersonPose3DArray().persons == []
    assert not PersonPose3D().keypoints
    assert not CalibrationResult().extrinsics


def test_a_package_that_is_missing_is_named_with_how_to_install_it():
    said = r"no message 'yolo_msgs/.*: install and source the package 'yolo_msgs': clone https://"
    with pytest.raises(InputError, match=said):
        message_class("yolo_msgs/msg/DetectionArray")


def test_messages_of_others_are_decoded_without_their_packages():
    empty = bytes.fromhex("0001000001000000020000000100000000000000") + bytes(4)
    message = decode("yolo_msgs/msg/DetectionArray", empty)
    assert (message.header.stamp.sec, message.persons) == (1, [])
