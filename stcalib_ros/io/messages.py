"""From messages to numbers: one conversion for bags and for live topics.

The messages are duck-typed: what `stcalib_ros.io.decode` decodes and what rclpy decodes give the
same numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.camera_info import intrinsics_from_camera_info
from stcalib_ros.core.model.keypoint_layouts import Layout, find_layout
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.io.limits import MAX_COORDINATE

NS = 1_000_000_000

Float32Array = NDArray[np.float32]
"""As the messages have it."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseImage:
    """All persons in one image of one camera: P persons, J joints.

    Attributes
    ----------
    stamp_ns : int
        By the camera's own clock, nanoseconds since the Unix epoch.
    frame_id : str
    layout : Layout
    rectified : bool
        The keypoints are those of the rectified image.
    metric : bool
        The 3D poses are in metres.
    track_ids : (P,) ndarray of int
        `NO_TRACK` where nobody tracks.
    scores : (P,) ndarray
        Of the persons, 0 where they were not finite.
    keypoints : (P, J, 2) ndarray of float32
        NaN where not observed, and where they are (0, 0), as some estimators have it then.
    joints : (P, J, 3) ndarray of float32, or None
        NaN where not observed; None: nobody has a 3D pose.
    joint_scores : (P, J) ndarray of float32
        0 where they were not finite.
    project : bool
        Keypoints are still to be projected from `joints`, see
        `stcalib_ros.io.keypoint_pixels.with_pixels`.
    fractions : bool
        Keypoints are still fractions of the image.
    n_infinite : int
        Infinite values that were taken as not observed.
    received_ns : int or None
        Time at which a recorder received the message by its own clock, nanoseconds since the Unix
        epoch; None where nobody has recorded it.
    """

    stamp_ns: int
    frame_id: str
    layout: Layout
    rectified: bool
    metric: bool
    track_ids: IntArray
    scores: Float64Array
    keypoints: Float32Array
    joints: Float32Array | None
    joint_scores: Float32Array
    project: bool = False
    fractions: bool = False
    n_infinite: int = 0
    received_ns: int | None = None


class CameraInfoFields(NamedTuple):
    """What of a ``sensor_msgs/CameraInfo`` determines the lens; comparable."""

    width: int
    height: int
    distortion_model: str
    d: tuple[float, ...]
    k: tuple[float, ...]
    r: tuple[float, ...]
    p: tuple[float, ...]
    binning_x: int
    binning_y: int
    roi: tuple[int, int, int, int]


def format_stamp(stamp_ns: int) -> str:
    """Stamp as ROS tools print it: seconds, dot, nine digits."""
    return f"{stamp_ns // NS}.{stamp_ns % NS:09d}"


def stamp_ns(message: Any) -> int:
    """Header stamp of a message in nanoseconds."""
    stamp = message.header.stamp
    return int(stamp.sec) * NS + int(stamp.nanosec)


def pose_image(message: Any, *, topic: str, received_ns: int | None = None) -> PoseImage:
    """Convert a ``PersonPose3DArray``.

    Parameters
    ----------
    message : object
        With the fields of ``stcalib_ros/msg/PersonPose3DArray``, see
        `stcalib_ros.io.message_types.Content`.
    topic : str
        For error messages.
    received_ns : int, optional
        When it was received, nanoseconds.

    Raises
    ------
    InputError
        The layout is unknown, an array has the wrong length, or the stamp is zero.
    """
    stamp = stamp_ns(message)
    if stamp == 0:
        raise InputError(
            f"{topic}: header stamp is zero; the publisher must stamp its messages with the "
            "acquisition time of the image"
        )
    layout = _layout(topic, str(message.layout), tuple(message.joint_names))
    persons = message.persons
    where = f"{topic}, stamp {format_stamp(stamp)}"
    keypoints = _rows(persons, "keypoints", layout, 2, where)
    joints = None
    if any(len(person.joints) for person in persons):
        joints = _rows(persons, "joints", layout, 3, where)
    scores = _rows(persons, "joint_scores", layout, 1, where)[..., 0]
    seen = _detected(keypoints)
    seen_joints = None if joints is None else _observed(joints)
    return PoseImage(
        stamp_ns=stamp,
        frame_id=str(message.header.frame_id),
        layout=layout,
        rectified=bool(message.rectified),
        metric=bool(message.metric),
        track_ids=np.array([p.track_id for p in persons], dtype=np.int64),
        scores=np.array([p.score if math.isfinite(p.score) else 0.0 for p in persons]),
        keypoints=seen,
        joints=seen_joints,
        joint_scores=np.where(np.isfinite(scores), scores, np.float32(0.0)),
        received_ns=received_ns,
        project=getattr(message, "project", False),
        fractions=getattr(message, "fractions", False),
        n_infinite=_n_infinite(keypoints, seen)
        + (0 if joints is None or seen_joints is None else _n_infinite(joints, seen_joints)),
    )


def camera_info_fields(message: Any) -> CameraInfoFields:
    """Lens of a ``sensor_msgs/CameraInfo``."""
    roi = message.roi
    return CameraInfoFields(
        width=int(message.width),
        height=int(message.height),
        distortion_model=str(message.distortion_model),
        d=tuple(map(float, message.d)),
        k=tuple(map(float, message.k)),
        r=tuple(map(float, message.r)),
        p=tuple(map(float, message.p)),
        binning_x=int(message.binning_x),
        binning_y=int(message.binning_y),
        roi=(int(roi.x_offset), int(roi.y_offset), int(roi.width), int(roi.height)),
    )


_USUAL_COEFFICIENTS = {
    LensModel.PLUMB_BOB: 5,
    LensModel.RATIONAL_POLYNOMIAL: 8,
    LensModel.EQUIDISTANT: 4,
}
"""Distortion coefficients that drivers and rectifying nodes expect at least, by lens model."""


def fields_of_lens(lens: Intrinsics) -> CameraInfoFields:
    """Return the ``sensor_msgs/CameraInfo`` of the image that a lens describes.

    Numbers of a lens that is not known are 0, as drivers without a calibration file have them.

    Parameters
    ----------
    lens : Intrinsics
        That of the published image: the region of interest and binning are done.
    """
    K = lens.K if lens.known else np.zeros((3, 3))
    D = np.pad(lens.D, (0, max(_USUAL_COEFFICIENTS[lens.model] - lens.D.size, 0)))
    return CameraInfoFields(
        width=int(lens.width),
        height=int(lens.height),
        distortion_model=lens.model.value if lens.known else "",
        d=tuple(D.tolist()) if lens.known else (),
        k=tuple(K.ravel().tolist()),
        r=tuple(lens.R_rect_cam.ravel().tolist()),
        p=tuple(np.hstack([K, np.zeros((3, 1))]).ravel().tolist()),
        binning_x=0,
        binning_y=0,
        roi=(0, 0, 0, 0),
    )


@lru_cache(maxsize=256)
def lens(info: CameraInfoFields, *, rectified: bool, topic: str) -> Intrinsics:
    """Intrinsics of the pixels that the keypoints are given in.

    Raises
    ------
    InputError
        The CameraInfo is not that of a calibrated camera; the message names the topic.
    """
    try:
        return intrinsics_from_camera_info(**info._asdict(), rectified=rectified)
    except InputError as error:
        raise InputError(f"{topic}: {error}") from None


@lru_cache(maxsize=256)
def _layout(topic: str, name: str, joint_names: tuple[str, ...]) -> Layout:
    try:
        return find_layout(name, joint_names)
    except InputError as error:
        raise InputError(f"{topic}: {error}") from None


def _rows(
    persons: Sequence[Any], field: str, layout: Layout, width: int, where: str
) -> Float32Array:
    """One flat field of all persons as (P, J, width); empty means nothing given."""
    n = layout.n_joints * width
    given = [getattr(person, field) for person in persons]
    if persons and all(len(values) == n for values in given):
        return np.array(given, dtype=np.float32).reshape(len(persons), layout.n_joints, width)
    out = np.empty((len(persons), n), dtype=np.float32)
    for row, person, values in zip(out, persons, given, strict=True):
        if len(values) == 0:
            row[:] = 1.0 if field == "joint_scores" else np.nan
        elif len(values) == n:
            row[:] = values
        else:
            raise InputError(
                f"{where}, track {person.track_id}: {field} has {len(values)} numbers, but layout "
                f"{layout.name!r} with {layout.n_joints} joints takes {n}"
            )
    return out.reshape(len(persons), layout.n_joints, width)


def _detected(keypoints: Float32Array) -> Float32Array:
    """Keypoints with a NaN or infinite coordinate, and those at (0, 0), become NaN."""
    points = _observed(keypoints)
    if points.all():
        return points
    return np.where(keypoints.any(axis=-1, keepdims=True), points, np.float32(np.nan))


def _observed(points: Float32Array) -> Float32Array:
    """Points with a coordinate that is NaN, infinite or as good as that become NaN."""
    small = np.abs(points) <= MAX_COORDINATE
    if small.all():
        return points
    return np.where(small.all(axis=-1, keepdims=True), points, np.float32(np.nan))


def _n_infinite(given: Float32Array, taken: Float32Array) -> int:
    """Count values that are infinite or as good as that; `taken` are the same without them."""
    if taken is given:
        return 0
    return int((np.abs(given) > MAX_COORDINATE).sum())
