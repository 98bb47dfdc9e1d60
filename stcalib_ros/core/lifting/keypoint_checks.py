"""Keypoints that cannot be those of people in an image: in other units, or all at one place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.lifting.limits import (
    MIN_JOINTS,
    NORMALISED_EXTENT,
    NORMALISED_PX,
    ONE_PLACE_PX,
)
from stcalib_ros.core.model.arrays import BoolArray, Float32Array, FloatArray
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark, RemarkCode


def require_shapes(recording: Recording) -> None:
    """Check that the arrays of every track are as long as the layout has joints.

    Raises
    ------
    InputError
        One is not; a track without 3D poses has joints (F, J, 3), too, which are NaN.
    """
    for camera in recording.cameras:
        J = camera.layout.n_joints
        for track in camera.tracks:
            F = len(track.frames)
            shapes = {"keypoints": (F, J, 2), "joints": (F, J, 3), "scores": (F, J)}
            for name, shape in shapes.items():
                if (given := np.shape(getattr(track, name))) != shape:
                    raise InputError(
                        f"camera {camera.name}, track {track.track_id}: {name} has shape {given}, "
                        f"but {F} frames of layout {camera.layout.name!r} with {J} joints take "
                        f"{shape}"
                    )


def keypoint_faults(recording: Recording, *, min_score: float) -> dict[str, Rejection]:
    """Return why the keypoints of a camera cannot be used, by the names of such cameras.

    Parameters
    ----------
    recording : Recording
    min_score : float
        Joints with a lower score are not looked at.
    """
    faults = {}
    for camera in recording.cameras:
        image = camera.intrinsics
        poses = full_poses(camera, min_score)
        fault = keypoint_fault(poses, camera=camera.name, width=image.width, height=image.height)
        if fault is not None:
            faults[camera.name] = fault
    return faults


def keypoint_fault(poses: FloatArray, *, camera: str, width: int, height: int) -> Rejection | None:
    """Return why the keypoints of a camera cannot be used; None if they can.

    Parameters
    ----------
    poses : (N, J, 2) ndarray
        Keypoints of all poses of at least six, px; NaN where not observed.
    camera : str
    width, height : int
        Size of its image, px.
    """
    if not len(poses):
        return None
    low, high = _bounds(poses)
    least, most = float(low.min()), float(high.max())
    extent = float(np.median((high - low).max(-1)))
    if max(-least, most) <= NORMALISED_PX and extent >= NORMALISED_EXTENT:
        values = {"least": least, "width": width, "height": height}
        reason = RejectionReason.KEYPOINTS_NORMALISED
        return Rejection(reason, (camera,), most, NORMALISED_PX, "px", values=values)
    largest = float((high - low).max())
    if largest <= ONE_PLACE_PX:
        reason = RejectionReason.KEYPOINTS_COINCIDE
        return Rejection(reason, (camera,), largest, ONE_PLACE_PX, "px")
    return None


def without_people(recording: Recording, names: Mapping[str, object]) -> Recording:
    """Return a recording in which the named cameras see nobody."""
    if not names:
        return recording
    cameras = (replace(c, tracks=()) if c.name in names else c for c in recording.cameras)
    return replace(recording, cameras=tuple(cameras))


def keypoint_remarks(recording: Recording, *, min_score: float) -> tuple[Remark, ...]:
    """Return how many poses of each camera are left out since they are at one place.

    Parameters are those of `keypoint_faults`, which names the cameras where that is all of them.
    """
    remarks = []
    for camera in recording.cameras:
        left_out = at_one_place(full_poses(camera, min_score))
        if left_out.any() and not left_out.all():
            values = {"n_left_out": int(left_out.sum()), "n_poses": len(left_out)}
            remarks.append(Remark(RemarkCode.POSES_LEFT_OUT, (camera.name,), values))
    return tuple(remarks)


def has_enough(keypoints: FloatArray) -> BoolArray:
    """Return which poses (F,) of keypoints (F, J, 2) have enough of them to be used."""
    return np.asarray(np.isfinite(keypoints).all(-1).sum(-1) >= MIN_JOINTS)


def at_one_place(keypoints: FloatArray) -> BoolArray:
    """Return which poses (F,) have all of their keypoints at one place: nobody is that small.

    Parameters
    ----------
    keypoints : (F, J, 2) ndarray
        Pixels; NaN where not observed. A single keypoint is no such pose.
    """
    if not keypoints.size:
        return np.zeros(len(keypoints), dtype=bool)
    low, high = _bounds(keypoints)
    several = np.isfinite(keypoints[..., 0]).sum(-1) > 1
    return np.asarray(several & (high - low <= ONE_PLACE_PX).all(-1))


def _bounds(keypoints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the least and the largest coordinates (F, 2) of poses; NaN where there are none."""
    by_joint = np.moveaxis(keypoints, 1, 0).reshape(keypoints.shape[1], -1)  # quick to reduce
    return tuple(f.reduce(by_joint).reshape(-1, 2) for f in (np.fmin, np.fmax))


def full_poses(camera: CameraRecording, min_score: float) -> Float32Array:
    """Return the keypoints (N, J, 2) of all poses of a camera of which enough count; else NaN.

    Parameters
    ----------
    camera : CameraRecording
    min_score : float
        Joints with a lower score do not count.
    """
    poses: list[FloatArray] = [np.zeros((0, camera.layout.n_joints, 2))]
    for track in camera.tracks:
        points = np.where((track.scores >= min_score)[..., None], track.keypoints, np.nan)
        poses.append(points[has_enough(points)])
    return np.concatenate(poses, dtype=np.float32)
