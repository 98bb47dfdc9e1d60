"""Records and messages with every field set; imported by the tests and by `talker.py`."""

from __future__ import annotations

import math

import numpy as np
from builtin_interfaces.msg import Time
from exclusion_helpers import left_out
from scipy.spatial.transform import Rotation
from stcalib_ros.msg import CalibrationResult, PersonPose3D, PersonPose3DArray
from std_msgs.msg import Header

from stcalib_ros.core.model.calibration import (
    Calibration,
    CameraCalibration,
    PairResidual,
    PersonAssociation,
    Status,
)
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.core.model.rejection import Rejection, RejectionReason
from stcalib_ros.ros.convert import calibration_result

LENS = Intrinsics(640, 480, LensModel.PLUMB_BOB, np.diag([600.0, 600.0, 1.0]), np.zeros(5))
STAMP = Time(sec=1_760_000_100, nanosec=7)


def camera(name: str, seed: int) -> CameraCalibration:
    rng = np.random.default_rng(seed)
    return CameraCalibration(
        name=name,
        frame_id=f"{name}_optical_frame",
        intrinsics=LENS,
        R_ref_cam=Rotation.from_rotvec(rng.normal(size=3)).as_matrix(),
        t_ref_cam=rng.normal(size=3),
        covariance=rng.normal(size=(6, 6)),
        time_offset_s=rng.normal(),
        time_offset_stddev_s=0.002,
        clock_skew=1e-6 * seed,
        line_time_s=1e-5 * (1 + seed),
    )


FEW_INLIERS = Rejection(RejectionReason.TOO_FEW_INLIERS, ("cam2",), 150.0, 400.0, "keypoints")


def calibration() -> Calibration:
    return Calibration(
        status=Status.OK,
        message="3 cameras from 2 persons",
        reference="cam1",
        metric=True,
        epoch_s=1_760_000_000.25,
        window_s=(1_760_000_000.25, 1_760_000_060.5),
        cameras=tuple(camera(f"cam{i}", i) for i in range(3)),
        uncalibrated=(left_out("cam3", "shares nobody with the others"),),
        rejections=(Rejection(RejectionReason.LOOKALIKES, ("cam1",)), FEW_INLIERS),
        persons=(
            PersonAssociation(0, {"cam0": (3,), "cam1": (7, 12)}, 1.5, 4.0),
            PersonAssociation(1, {"cam2": (1,)}, 2.5),
        ),
        pairs=(PairResidual("cam0", "cam1", 2, 0.125, 1.75),),
        reprojection_rms_px=2.25,
        n_observations=5000,
        n_inliers=4700,
        joint_covariance=np.arange(4.0).reshape(2, 2),
        parameter_order=("cam0.x", "cam0.time_offset_s"),
    )


def result_message() -> CalibrationResult:
    return calibration_result(
        calibration(), run_id="run-1", stamp=STAMP, frame_rates={"cam0": 30.0}
    )


def poses_message() -> PersonPose3DArray:
    rng = np.random.default_rng(0)
    keypoints = rng.uniform(0, 640, 34).astype(np.float32)
    keypoints[4:6] = math.nan
    return PersonPose3DArray(
        header=Header(stamp=STAMP, frame_id="cam0_optical_frame"),
        layout="h36m_17",
        rectified=True,
        metric=False,
        persons=[
            PersonPose3D(
                track_id=5,
                score=0.75,
                joints=rng.normal(size=51).astype(np.float32),
                keypoints=keypoints,
                joint_scores=rng.uniform(size=17).astype(np.float32),
            )
        ],
    )
