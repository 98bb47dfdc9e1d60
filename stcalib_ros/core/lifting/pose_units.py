"""Whether 3D poses that are said to be metric are in metres: people have the size of people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stcalib_ros.core.lifting.body_size import pose_size
from stcalib_ros.core.lifting.limits import MAX_BODY_SIZE
from stcalib_ros.core.model.recording import CameraRecording, without_3d_poses
from stcalib_ros.core.model.rejection import Remark, RemarkCode
from stcalib_ros.core.model.skeleton import ADULT_HEIGHT_M, body_bones

_UNITS = {"millimetres": 1000.0, "centimetres": 100.0}
"""Units that are recognised, and how many of them a metre has. Definition. Others are too near to
sizes that poses up to scale may have by chance."""
_MAX_POSES = 100
"""Poses of a camera that are measured, about. Numerical: bounds the cost."""


def in_metres(
    cameras: Sequence[CameraRecording], *, needed: bool = False
) -> tuple[tuple[CameraRecording, ...], tuple[Remark, ...]]:
    """Return cameras whose metric 3D poses are in metres, with remarks on those that were not.

    Poses in a known unit are converted. Others are not metric; they have no 3D poses then if those
    of another camera are, so that the unit of the result is the metre all the same.

    Parameters
    ----------
    cameras : sequence of CameraRecording
    needed : bool
        Every camera has to have 3D poses: they stay, and no camera may be metric.
    """
    judged = [_in_metres(camera) for camera in cameras]
    some_metric = not needed and any(
        camera.metric and camera.has_3d_poses and size_known for camera, size_known, _ in judged
    )
    found, remarks = [], []
    for camera, size_known, own in judged:
        found.append(without_3d_poses(camera) if some_metric and not size_known else camera)
        remarks += own
    return tuple(found), tuple(remarks)


def _in_metres(camera: CameraRecording) -> tuple[CameraRecording, bool, list[Remark]]:
    """Return a camera in metres, or not metric; whether it is as it should be; and a remark."""
    size = _size(camera) if camera.metric else np.nan
    if not np.isfinite(size) or _plausible(size):
        return camera, True, []
    height = {"height_m": ADULT_HEIGHT_M * size}
    for unit, per_metre in _UNITS.items():
        if _plausible(size / per_metre):
            remark = Remark(RemarkCode.POSES_RESCALED, (camera.name,), height, unit)
            return _divided(camera, per_metre), True, [remark]
    remark = Remark(RemarkCode.POSES_NOT_METRIC, (camera.name,), height)
    return replace(camera, metric=False), False, [remark]


def _plausible(size: float) -> bool:
    return 1.0 / MAX_BODY_SIZE < size < MAX_BODY_SIZE


def _size(camera: CameraRecording) -> float:
    """Return the size of the bodies of a camera over that of an adult; NaN where not known."""
    stride = max(1, sum(len(track.frames) for track in camera.tracks) // _MAX_POSES)
    some = [track.joints[::stride] for track in camera.tracks]
    if not some or not np.isfinite(joints := np.concatenate(some)).any():
        return float("nan")
    return pose_size(joints.astype(np.float64), *body_bones(camera.layout))


def _divided(camera: CameraRecording, by: float) -> CameraRecording:
    return replace(camera, tracks=tuple(replace(t, joints=t.joints / by) for t in camera.tracks))
