"""Core records to our ROS messages and back, and message classes by the names of their types."""

from __future__ import annotations

import math
from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseWithCovariance, Quaternion
from rclpy.serialization import deserialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, RegionOfInterest
from std_msgs.msg import Header

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import (
    Calibration,
    CameraCalibration,
    PairResidual,
    PersonAssociation,
)
from stcalib_ros.core.model.lens_knowledge import LensStddev
from stcalib_ros.core.model.rejection import Rejection
from stcalib_ros.core.model.rejection_text import labelled
from stcalib_ros.io import message_types
from stcalib_ros.io.message_types import CAMERA_INFO, PERSON_POSES, TYPES
from stcalib_ros.io.messages import NS, CameraInfoFields, fields_of_lens
from stcalib_ros.io.stamps import ClockCorrection
from stcalib_ros.msg import CalibrationResult, CameraExtrinsics, CameraIntrinsics, TimeOffset
from stcalib_ros.msg import PairResidual as PairResidualMessage
from stcalib_ros.msg import PersonAssociation as PersonAssociationMessage
from stcalib_ros.msg import Rejection as RejectionMessage

_LARGEST = float(np.finfo(np.float32).max)


def message_class(type_name: str) -> Any:
    """Return the class of a message type.

    Parameters
    ----------
    type_name : str
        ``package/msg/Name``.

    Raises
    ------
    InputError
        Its package is not installed, or has no such message.
    """
    package, _, name = type_name.partition("/msg/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        known = TYPES.get(type_name)
        how = f": {known.install}" if known is not None and known.install else ""
        raise InputError(
            f"no message {type_name!r} here: install and source the package {package!r}{how}"
        ) from None


def decode(type_name: str, data: bytes) -> Any:
    """Decode a message with ROS's own deserializer; a decoder for `stcalib_ros.io.bag.read_bag`.

    Messages of other packages, which need not be installed, are decoded by us.

    Parameters
    ----------
    type_name : str
        One of `stcalib_ros.io.message_types.TYPES`.
    data : bytes
        Plain CDR.
    """
    if type_name not in (PERSON_POSES.name, CAMERA_INFO.name):
        return message_types.decode(type_name, data)
    return deserialize_message(data, message_class(type_name))


def time_message(stamp_s: float) -> Time:
    """Stamp from Unix seconds, as precise as float64 is; NaN gives zero."""
    if not math.isfinite(stamp_s):
        return Time()
    whole, fraction = divmod(stamp_s, 1.0)
    carry, nanosec = divmod(round(fraction * NS), NS)
    return Time(sec=int(whole) + carry, nanosec=nanosec)


def calibration_result(
    calibration: Calibration,
    *,
    run_id: str,
    stamp: Time,
    frame_rates: Mapping[str, float] | None = None,
) -> CalibrationResult:
    """Message that carries all of a calibration.

    Parameters
    ----------
    calibration : Calibration
    run_id : str
        Names the run.
    stamp : builtin_interfaces.msg.Time
        When the calibration was made.
    frame_rates : mapping of str to float, optional
        Images per second by camera name, for ``TimeOffset.offset_frames``; NaN without.

    Returns
    -------
    stcalib_ros.msg.CalibrationResult
        Poses are T_ref_cam.
    """
    window_start, window_end = map(time_message, calibration.window_s)
    return CalibrationResult(
        header=_header(calibration, stamp),
        run_id=run_id,
        status=int(calibration.status),
        message=calibration.message,
        extrinsics=extrinsics_messages(calibration, stamp=stamp),
        time_offsets=time_offset_messages(calibration, stamp=stamp, frame_rates=frame_rates),
        persons=[_person(p) for p in calibration.persons],
        pairs=[_pair(p) for p in calibration.pairs],
        reprojection_rms_px=calibration.reprojection_rms_px,
        n_observations=calibration.n_observations,
        n_inliers=calibration.n_inliers,
        window_start=window_start,
        window_end=window_end,
        scale_stddev=calibration.scale_stddev,
        joint_covariance=calibration.joint_covariance.ravel().tolist(),
        parameter_order=list(calibration.parameter_order),
        reasons=[_rejection(r) for r in calibration.reasons],
        intrinsics=intrinsics_messages(calibration, stamp=stamp),
    )


def extrinsics_messages(calibration: Calibration, *, stamp: Time) -> list[CameraExtrinsics]:
    """Poses T_ref_cam of all calibrated cameras, the reference included."""
    header = _header(calibration, stamp)
    return [
        CameraExtrinsics(
            header=header,
            camera=camera.name,
            child_frame_id=camera.frame_id,
            pose=_pose(camera),
            metric=calibration.metric,
        )
        for camera in calibration.cameras
    ]


def time_offset_messages(
    calibration: Calibration,
    *,
    stamp: Time,
    frame_rates: Mapping[str, float] | None = None,
) -> list[TimeOffset]:
    """Clocks of all calibrated cameras; parameters as of `calibration_result`."""
    header = _header(calibration, stamp)
    epoch = time_message(calibration.epoch_s)
    rates = frame_rates or {}
    return [
        TimeOffset(
            header=header,
            camera=camera.name,
            reference=calibration.reference,
            offset_s=camera.time_offset_s,
            offset_stddev_s=camera.time_offset_stddev_s,
            skew=camera.clock_skew,
            skew_stddev=camera.clock_skew_stddev,
            epoch=epoch,
            offset_frames=camera.time_offset_s * rates.get(camera.name, math.nan),
            line_time_s=camera.line_time_s,
            line_time_stddev_s=camera.line_time_stddev_s,
        )
        for camera in calibration.cameras
    ]


def intrinsics_messages(calibration: Calibration, *, stamp: Time) -> list[CameraIntrinsics]:
    """Lenses of all calibrated cameras, given and estimated ones."""
    return [
        CameraIntrinsics(
            camera=camera.name,
            knowledge=camera.lens_knowledge.value,
            camera_info=camera_info_message(
                fields_of_lens(camera.intrinsics), Header(stamp=stamp, frame_id=camera.frame_id)
            ),
            **_lens_stddev(camera.lens_stddev),
        )
        for camera in calibration.cameras
    ]


def camera_info_message(fields: CameraInfoFields, header: Header) -> CameraInfo:
    """Message of the numbers that determine a lens."""
    numbers = fields._asdict()
    region = dict(zip(("x_offset", "y_offset", "width", "height"), numbers.pop("roi"), strict=True))
    return CameraInfo(header=header, roi=RegionOfInterest(**region), **numbers)


def _lens_stddev(stddev: LensStddev | None) -> dict[str, Any]:
    """Fields of standard deviations; NaN where nothing was estimated."""
    if stddev is None:
        return dict.fromkeys(("focal_stddev_px", "cx_stddev_px", "cy_stddev_px"), math.nan)
    return {
        "focal_stddev_px": stddev.focal_px or math.nan,
        "cx_stddev_px": stddev.cx_px or math.nan,
        "cy_stddev_px": stddev.cy_px or math.nan,
        "radial_stddev": list(stddev.radial),
    }


def clock_corrections(message: CalibrationResult) -> dict[str, ClockCorrection]:
    """What to add to the stamps of each camera of a result, by its name.

    Raises
    ------
    InputError
        A number is not finite.
    """
    return {
        offset.camera: ClockCorrection(
            offset.offset_s, offset.skew, offset.epoch.sec * NS + offset.epoch.nanosec
        )
        for offset in message.time_offsets
    }


def _single(value: float) -> float:
    """Return a number that a field of float32 can hold: the largest one for what is beyond."""
    return max(-_LARGEST, min(value, _LARGEST)) if math.isfinite(value) else value


def _header(calibration: Calibration, stamp: Time) -> Header:
    return Header(stamp=stamp, frame_id=calibration.reference_frame)


def _pose(camera: CameraCalibration) -> PoseWithCovariance:
    x, y, z = map(float, camera.t_ref_cam)
    qx, qy, qz, qw = map(float, Rotation.from_matrix(camera.R_ref_cam).as_quat())
    return PoseWithCovariance(
        pose=Pose(
            position=Point(x=x, y=y, z=z),
            orientation=Quaternion(x=qx, y=qy, z=qz, w=qw),
        ),
        covariance=np.ascontiguousarray(camera.covariance, dtype=np.float64).ravel(),
    )


def _person(person: PersonAssociation) -> PersonAssociationMessage:
    seen = [(camera, track) for camera, tracks in person.tracks.items() for track in tracks]
    return PersonAssociationMessage(
        person_id=person.person_id,
        cameras=[camera for camera, _ in seen],
        track_ids=[track for _, track in seen],
        reprojection_rms_px=_single(person.reprojection_rms_px),
        margin=_single(person.margin),
    )


def _rejection(rejection: Rejection) -> RejectionMessage:
    return RejectionMessage(
        code=rejection.reason.value,
        cameras=list(rejection.cameras),
        measured=float(rejection.measured),
        limit=float(rejection.limit),
        unit=rejection.unit,
        message=labelled(rejection),
    )


def _pair(pair: PairResidual) -> PairResidualMessage:
    return PairResidualMessage(
        camera_a=pair.camera_a,
        camera_b=pair.camera_b,
        n_matches=pair.n_matches,
        median_angle_rad=_single(pair.median_angle_rad),
        epipolar_rms_px=_single(pair.epipolar_rms_px),
    )
