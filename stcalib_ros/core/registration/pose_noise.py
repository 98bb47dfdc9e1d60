"""Uncertainty of a registration by 3D poses, measured on the poses themselves.

There are two parts. Poses that turn the two cameras differently, from person to person and from
time to time, have errors of their own in each frame. Poses that do not project onto the key
points of their own image have errors that stay: what is off across the optical axis will be off
along it as well. Exact poses show neither.
"""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.geometry.interpolation import Interpolation, frame_period
from stcalib_ros.core.lifting.limits import MIN_JOINTS
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, FloatArray
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.registration.limits import (
    DIRECTION_RATIO,
    MAX_ROTATION_STDDEV,
    SCATTER_FACTOR,
)

_BLOCKS = 8
"""Stretches of a track that count as independent samples of the errors of its poses. Numerical."""
_MAX_FRAMES = 100
"""Frames of a track that are compared, at most. Numerical: bounds the cost."""


def registration_stddev(
    cam_a: LiftedCamera, cam_b: LiftedCamera, h: RelativePose
) -> tuple[float, float]:
    """Standard deviations (rad) of R_a_b and of the direction of t_a_b of a registration.

    Parameters
    ----------
    cam_a, cam_b : LiftedCamera
    h : RelativePose
        Registration by bone directions and body positions, not refined.
    """
    torques: list[Float64Array] = []
    inertia = np.zeros((3, 3))
    misfits = []
    period = frame_period(cam_b.stamps)
    for p, q in h.matches:
        track_a, track_b = _thinned(cam_a.tracks[p]), cam_b.tracks[q]
        at = Interpolation(
            cam_b.stamps[track_b.frames],
            cam_a.stamps[track_a.frames] + h.lag_s,
            period=period,
        )
        body_a, body_b = _centred(track_a.joints_cam, at(track_b.joints_cam) @ h.R_a_b.T)
        if not len(body_a):
            continue
        blocks = np.array_split(np.cross(body_b, body_a).sum(1), min(_BLOCKS, len(body_a)))
        torques += [block.sum(0) for block in blocks]
        inertia += (body_b**2).sum() * np.eye(3) - np.einsum("fja,fjb->ab", body_b, body_b)
        misfits += [_misfit(track_a), _misfit(_thinned(track_b))]
    if len(torques) < 2:
        return MAX_ROTATION_STDDEV, DIRECTION_RATIO * MAX_ROTATION_STDDEV
    by_poses = _rotation_error(np.array(torques), inertia)
    rotation = min(MAX_ROTATION_STDDEV, float(np.hypot(by_poses, np.nanmean(misfits))))
    return rotation, DIRECTION_RATIO * rotation


def _thinned(track: LiftedTrack) -> LiftedTrack:
    return track[:: -(-len(track.frames) // _MAX_FRAMES)]


def _centred(joints_a: FloatArray, joints_b: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Joints that both views know, relative to their centre; zero where unknown."""
    both: BoolArray = np.asarray(np.isfinite(joints_a + joints_b).all(-1))
    rows = both.sum(-1) >= MIN_JOINTS
    known = both[rows, :, None]
    n = known.sum(1, keepdims=True)
    bodies = (np.where(known, one[rows], 0.0) for one in (joints_a, joints_b))
    body_a, body_b = (np.where(known, b - b.sum(1, keepdims=True) / n, 0.0) for b in bodies)
    return body_a, body_b


def _misfit(track: LiftedTrack) -> float:
    """Distance of projected joints from their keypoints, over the size of the body (rad)."""
    joints = track.joints_cam
    depth = joints[..., 2:]
    distance = np.linalg.norm(joints[..., :2] - track.x * depth, axis=-1)
    observed = np.isfinite(distance)
    if not observed.any():
        return float("nan")
    centred = joints - np.nanmean(
        np.where(observed[..., None], joints, np.nan), axis=1, keepdims=True
    )
    return float(np.median(distance[observed]) / np.sqrt((centred[observed] ** 2).sum(-1).mean()))


def _rotation_error(torques: Float64Array, inertia: Float64Array) -> float:
    """Standard deviation of the rotation, by mean and scatter of the torques (K, 3) of blocks."""
    K = len(torques)
    turns = np.linalg.solve(inertia, torques.T).T
    scatter = SCATTER_FACTOR**2 * K * turns.var(0, ddof=1)
    return float(np.sqrt((scatter + turns.sum(0) ** 2).sum()))
