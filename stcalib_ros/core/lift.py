"""Monocular 3D poses brought to the metric frame of their camera.

A lifter gives joints relative to a root, often tilted and, when it works on a crop of the
image, turned by the angle of the crop off the optical axis. The key points of the same
image say where the person is and undo most of that rotation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.geometry import bearings, exp_so3, hat
from stcalib_ros.core.shutter import GLOBAL, Shutter, shutter_of
from stcalib_ros.core.skeleton import Skeleton
from stcalib_ros.core.types import BoolArray, CameraRecording, FloatArray, IntArray, Recording

_CAUCHY = 0.02
"""Scale of the robust loss on the plane z = 1: a joint error of 8 cm at 4 m."""
_ROTATION_PRIOR = 0.003
"""Weight of the squared rotation: one standard deviation of about ten degrees."""
_MAX_ROTATION = 0.3
_MIN_JOINTS = 6
_NEAREST = 0.3
_STEPS = 2


@dataclass(frozen=True, slots=True, eq=False)
class LiftedTrack:
    """One track in the metric frame of its camera, as precise as the recording is.

    Attributes
    ----------
    track_id : int
    frames : (F,) ndarray of int
        Indices into the stamps of the camera.
    x : (F, J, 2) ndarray
        Undistorted key points on the plane z = 1; NaN where not used.
    focal : (F, J) ndarray
        Pixels per unit of `x`.
    joints_cam : (F, J, 3) ndarray
        Joints in the optical frame, metres; NaN where the frame could not be lifted.
    rows : (F, J) ndarray or None
        Of the key points in the image, px, counted from the middle row of the shutter; None where
        all shutters take all rows at once.
    """

    track_id: int
    frames: IntArray
    x: FloatArray
    focal: FloatArray
    joints_cam: FloatArray
    rows: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LiftedCamera:
    """All lifted tracks of one camera.

    Attributes
    ----------
    name : str
    stamps : (N,) ndarray
        Seconds by its own clock; of the middle row of its shutter.
    tracks : tuple of LiftedTrack
    shutter : Shutter
    """

    name: str
    stamps: FloatArray
    tracks: tuple[LiftedTrack, ...]
    shutter: Shutter = GLOBAL


def lift_recording(
    recording: Recording,
    skeleton: Skeleton,
    *,
    min_score: float,
    turn: bool = True,
    rows: bool = False,
    from_first_row: bool = False,
) -> tuple[LiftedCamera, ...]:
    """Lift every track of every camera; tracks that cannot be lifted at all are left out.

    Parameters
    ----------
    recording : Recording
    skeleton : Skeleton
    min_score : float
        Joints with a lower score are not used.
    turn : bool
        Turn the poses onto their key points; else they are placed only.
    rows : bool
        Keep the rows of the key points though all shutters take all rows at once.
    from_first_row : bool
        Rows and stamps are those from row 0 on, not from the middle.
    """
    steps = _STEPS if turn else 0
    rolling = rows or any(camera.line_time_s for camera in recording.cameras)
    return tuple(
        _lift_camera(
            *(camera, columns, skeleton, min_score, steps),
            shutter_of(camera, from_first_row=from_first_row) if rolling else None,
        )
        for camera, columns in zip(recording.cameras, skeleton.columns, strict=True)
    )


def _lift_camera(
    camera: CameraRecording,
    columns: IntArray,
    skeleton: Skeleton,
    min_score: float,
    steps: int,
    shutter: Shutter | None,
) -> LiftedCamera:
    tracks = []
    for track in camera.tracks:
        scores, precision = track.scores[:, columns], track.keypoints.dtype
        pixels = np.where((scores >= min_score)[..., None], track.keypoints[:, columns], np.nan)
        x, focal = bearings(pixels, camera.intrinsics)
        joints = track.joints[:, columns].astype(np.float64)
        if not camera.metric:
            joints = joints * _body_scale(joints, skeleton)
        joints_cam = lift(joints, x, steps=steps)
        usable = np.isfinite(joints_cam).any((1, 2))
        if usable.any():
            tracks.append(
                LiftedTrack(
                    track.track_id,
                    track.frames[usable],
                    x[usable].astype(precision),
                    focal[usable].astype(precision),
                    joints_cam[usable].astype(precision),
                    None if shutter is None else pixels[usable, :, 1] - shutter.middle_row,
                )
            )
    shutter = shutter or GLOBAL
    return LiftedCamera(camera.name, shutter.times(camera.stamps), tuple(tracks), shutter)


def _body_scale(joints: FloatArray, skeleton: Skeleton) -> float:
    """Factor that gives the skeleton of one track the size of an adult."""
    known = np.flatnonzero(np.isfinite(skeleton.adult_lengths))
    rows = skeleton.directions[known]
    bones = np.einsum("dj,fjk->fdk", rows, np.nan_to_num(joints))
    complete = ~np.einsum("dj,fj->fd", rows != 0, ~np.isfinite(joints).all(-1)).astype(bool)
    lengths = np.where(complete, np.linalg.norm(bones, axis=-1), np.nan)
    measured = complete.any(0)
    if not measured.any():
        return 1.0
    total = float(np.nanmedian(lengths[:, measured], axis=0).sum())
    adult = float(skeleton.adult_lengths[known][measured].sum())
    return adult / total if total > 0 else 1.0


def lift(joints: FloatArray, x: FloatArray, *, steps: int = _STEPS) -> FloatArray:
    """Place and turn monocular poses so that they project onto their key points.

    The position of the root is the closed-form solution of ``argmin_T sum_s |(I - b b^T)
    (Y_s + T)|^2`` with the bearings b of the key points; then Gauss-Newton steps on the
    robust image error for the root and a rotation that a prior keeps small.

    Parameters
    ----------
    joints : (F, J, 3) ndarray
        Y, in the axes of the optical frame, any origin, metres; NaN where unknown.
    x : (F, J, 2) ndarray
        Key points on the plane z = 1; NaN where not seen.
    steps : int
        Gauss-Newton steps.

    Returns
    -------
    (F, J, 3) ndarray
        Joints in the optical frame; NaN for frames with fewer than six usable joints or
        with a person that would be behind the camera.
    """
    known = np.asarray(np.isfinite(joints).all(-1))
    used = np.asarray(known & np.isfinite(x).all(-1))
    enough = used.sum(-1) >= _MIN_JOINTS
    Y = np.where(known[..., None], joints, 0.0)
    centre = Y.sum(1, keepdims=True) / np.maximum(known.sum(-1), 1)[:, None, None]
    Y = np.where(known[..., None], Y - centre, 0.0)
    target = np.where(used[..., None], x, 0.0)
    root, solved = _place(Y, target, used & enough[:, None])
    for _ in range(steps):
        Y, root = _turn(Y, root, target, used)
    ahead = (Y[..., 2] + root[:, None, 2] > _NEAREST) | ~used
    good = enough & solved & ahead.all(-1)
    return np.where((good[:, None] & known)[..., None], Y + root[:, None], np.nan)


def _place(Y: FloatArray, x: FloatArray, used: BoolArray) -> tuple[FloatArray, BoolArray]:
    b = np.concatenate([x, np.ones_like(x[..., :1])], -1)
    b /= np.linalg.norm(b, axis=-1, keepdims=True)
    P = used[..., None, None] * (np.eye(3) - b[..., :, None] * b[..., None, :])
    A = P.sum(1)
    rhs = -np.einsum("fjab,fjb->fa", P, Y)
    good = np.linalg.det(A) > 1e-6
    root = np.linalg.solve(np.where(good[:, None, None], A, np.eye(3)), rhs[..., None])[..., 0]
    return root, good & (root[:, 2] > _NEAREST)


def _turn(
    Y: FloatArray, root: FloatArray, x: FloatArray, used: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """One Gauss-Newton step for the root and a small rotation of the pose about it."""
    X = Y + root[:, None]
    depth = np.maximum(X[..., 2], _NEAREST)
    residual = X[..., :2] / depth[..., None] - x
    weight = used / (1.0 + (residual**2).sum(-1) / _CAUCHY**2)
    J_X = np.zeros((*Y.shape[:2], 2, 3))
    J_X[..., 0, 0] = J_X[..., 1, 1] = 1.0 / depth
    J_X[..., :, 2] = -X[..., :2] / depth[..., None] ** 2
    J_omega = J_X @ np.swapaxes(hat(Y), -1, -2)
    J = np.concatenate([J_omega, J_X], -1).reshape(len(Y), 2 * Y.shape[1], 6)
    weighted = np.swapaxes(J * np.repeat(weight, 2, axis=1)[..., None], -1, -2)
    H = weighted @ J
    H[:, range(3), range(3)] += _ROTATION_PRIOR
    H[:, range(6), range(6)] += 1e-9
    g = weighted @ residual.reshape(len(Y), 2 * Y.shape[1], 1)
    step = -np.linalg.solve(H, g)[..., 0]
    omega = step[:, :3]
    length = np.linalg.norm(omega, axis=-1, keepdims=True)
    omega = omega * np.minimum(1.0, _MAX_ROTATION / np.maximum(length, 1e-12))
    return Y @ np.swapaxes(exp_so3(omega), -1, -2), root + step[:, 3:]
