"""Monocular 3D poses brought to the metric frame of their camera.

A lifter gives joints relative to a root, often tilted and, when it works on a crop of the image,
turned by the angle of the crop off the optical axis. The keypoints of the same image determine
where the person is and most of that rotation. Where a lens is wide, that angle is too large for
small steps: which fraction of it to undo first is chosen on all keypoints of a camera.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stcalib_ros.core.geometry.lens import bearings
from stcalib_ros.core.geometry.so3 import exp_so3, hat
from stcalib_ros.core.geometry.triangulation import unit_rays
from stcalib_ros.core.lifting.body_size import pose_size, root_by_size
from stcalib_ros.core.lifting.keypoint_checks import at_one_place
from stcalib_ros.core.lifting.limits import (
    KEYPOINT_SCALE,
    MAX_ROTATION,
    MIN_DETERMINANT,
    MIN_JOINTS,
    NEAREST_M,
    ROTATION_PRIOR,
)
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, FloatArray, IntArray
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.model.recording import CameraRecording, Recording, Track, unknown_joints
from stcalib_ros.core.model.rolling_shutter import GLOBAL, Shutter, shutter_of
from stcalib_ros.core.model.skeleton import Skeleton

_STEPS = 2
"""Gauss-Newton steps by default. Numerical: the closed form is near, and the prior is strong."""
_CROP_FRACTIONS = (0.0, 0.5, 1.0)
"""Fractions of the crop rotation that are tried: known lifters do one of these."""
_MAX_CROP_FRAMES = 300
"""Frames by which the crop fraction is chosen, about. Numerical: bounds the cost."""


def lift_recording(
    recording: Recording,
    skeleton: Skeleton,
    *,
    min_score: float,
    turn: bool = True,
    rows: bool = False,
    from_first_row: bool = False,
) -> tuple[LiftedCamera, ...]:
    """Lift every track of every camera; tracks without a frame of six keypoints are left out.

    Poses with all keypoints at one place are no persons, and have no keypoints.

    Parameters
    ----------
    recording : Recording
    skeleton : Skeleton
    min_score : float
        Joints with a lower score are not used.
    turn : bool
        Turn the poses onto their keypoints; else they are placed only.
    rows : bool
        Keep the rows of the keypoints though all shutters take all rows at once.
    from_first_row : bool
        Rows and stamps are those from row 0 on, not from the middle.
    """
    rolling = rows or any(camera.line_time_s for camera in recording.cameras)
    return tuple(
        _lift_camera(
            camera,
            columns,
            skeleton,
            min_score=min_score,
            turn=turn,
            shutter=shutter_of(camera, from_first_row=from_first_row) if rolling else None,
        )
        for camera, columns in zip(recording.cameras, skeleton.columns, strict=True)
    )


def _lift_camera(
    camera: CameraRecording,
    columns: IntArray,
    skeleton: Skeleton,
    *,
    min_score: float,
    turn: bool,
    shutter: Shutter | None,
) -> LiftedCamera:
    poses = []
    for track in camera.tracks:
        pixels = _used_keypoints(track, columns, min_score)
        x, focal = bearings(pixels, camera.intrinsics)
        joints = _metric(track.joints[:, columns], camera, skeleton)
        poses.append((track, pixels[..., 1], x, focal, joints))
    given = [(joints, x) for _, _, x, _, joints in poses if joints is not None]
    crop = crop_fraction(given) if turn and given else 0.0
    tracks = []
    for track, rows, x, focal, joints in poses:
        if joints is None:
            joints_cam: FloatArray = unknown_joints(x)
        else:
            joints_cam = lift(joints, x, crop=crop, steps=_STEPS if turn else 0)
        usable = np.isfinite(x[..., 0]).sum(-1) >= MIN_JOINTS
        root_cam = _roots(joints_cam, x, skeleton)
        if usable.any():
            x_used, focal_used, joints_used, root_used = (
                as_precise(value[usable], track.keypoints)
                for value in (x, focal, joints_cam, root_cam)
            )
            relative = None if shutter is None else rows[usable] - shutter.middle_row
            own = (x_used, focal_used, joints_used, root_used, relative)
            tracks.append(LiftedTrack(track.track_id, track.frames[usable], *own))
    return _lifted(camera, shutter or GLOBAL, tracks)


def _lifted(
    camera: CameraRecording, shutter: Shutter, tracks: Sequence[LiftedTrack]
) -> LiftedCamera:
    return LiftedCamera(
        *(camera.name, shutter.times(camera.stamps), tuple(tracks), shutter),
        received=camera.received,
        intrinsics=camera.intrinsics,
        lens_knowledge=camera.lens_knowledge or LensKnowledge.GIVEN,
        lens_group=camera.lens_group,
        lens_prior=camera.lens_prior,
    )


def _used_keypoints(track: Track, columns: IntArray, min_score: float) -> FloatArray:
    """Return the keypoints (F, J, 2) of a track that are used, px; else NaN."""
    scored = (track.scores[:, columns] >= min_score)[..., None]
    pixels: FloatArray = np.where(scored, track.keypoints[:, columns], np.nan)
    pixels[at_one_place(pixels)] = np.nan
    return pixels


def _metric(joints: FloatArray, camera: CameraRecording, skeleton: Skeleton) -> Float64Array | None:
    """Return 3D poses in metres by the size of an adult, where they are not given so; else None."""
    if not np.isfinite(joints).any():
        return None
    poses = joints.astype(np.float64)
    if camera.metric:
        return poses
    size = pose_size(poses, skeleton.directions, skeleton.adult_lengths)
    return np.asarray(poses / size) if np.isfinite(size) else poses


def _roots(joints_cam: FloatArray, x: Float64Array, skeleton: Skeleton) -> Float64Array:
    """Return the middle (F, 3) of the body in every frame: of the 3D pose, else by its size."""
    known = np.isfinite(joints_cam[..., 0])
    total: Float64Array = np.where(known[..., None], joints_cam, 0.0).sum(1, dtype=np.float64)
    root = total / np.maximum(known.sum(1), 1)[:, None]
    without = ~known.any(1)
    if without.any():
        root[without] = root_by_size(x[without], skeleton)
    return np.asarray(root)


def as_precise(values: Float64Array, given: FloatArray) -> FloatArray:
    """Return values in the precision of what they were computed from."""
    return values.astype(np.float32) if given.dtype == np.float32 else values


def crop_fraction(poses: Sequence[tuple[Float64Array, Float64Array]]) -> float:
    """Estimate how much of the crop rotation the poses of a camera contain.

    A lifter that is given a crop of the image does not know where the crop was, and turns its pose
    from the person's bearing to the optical axis; one that is given the place does not. Some do
    half of it.

    Parameters
    ----------
    poses : sequence of ((F, J, 3) ndarray, (F, J, 2) ndarray)
        Per track, joints and keypoints as for `lift`.

    Returns
    -------
    float
        Fraction of the crop rotation, 0, 1/2 or 1, with which the placed poses project onto the
        keypoints best.
    """
    stride = max(1, sum(len(joints) for joints, _ in poses) // _MAX_CROP_FRAMES)
    some = [_centred(joints[::stride], x[::stride]) for joints, x in poses]
    misfits = [sum(_misfit(*one, fraction) for one in some) for fraction in _CROP_FRACTIONS]
    return _CROP_FRACTIONS[int(np.argmin(misfits))]


def _misfit(Y: Float64Array, x: Float64Array, used: BoolArray, crop: float) -> float:
    """Sum of the robust image errors of poses, rotated by a fraction of the crop and placed."""
    turned = _undo_crop(Y, x, used, crop)
    root, solved = _place(turned, x, used)
    X = turned + np.where(solved[:, None], root, [0.0, 0.0, 1.0])[:, None]
    residual = X[..., :2] / np.maximum(X[..., 2:], NEAREST_M) - x
    square = np.where(used, (residual**2).sum(-1), 0.0)
    return float(np.log1p(square / KEYPOINT_SCALE**2).sum())


def _undo_crop(Y: Float64Array, x: Float64Array, used: BoolArray, crop: float) -> Float64Array:
    """Rotate poses by a fraction of the angle from the optical axis to their keypoints."""
    n_usable = np.maximum(used.sum(-1), 1)[:, None]
    middle = np.where(used[..., None], x, 0.0).sum(1) / n_usable
    off_axis = np.linalg.norm(middle, axis=-1, keepdims=True)
    axis = np.stack([-middle[:, 1], middle[:, 0], np.zeros(len(x))], -1)
    rotvec = crop * np.arctan(off_axis) * axis / np.maximum(off_axis, 1e-12)
    return np.asarray(Y @ np.swapaxes(exp_so3(rotvec), -1, -2))


def _centred(joints: Float64Array, x: Float64Array) -> tuple[Float64Array, Float64Array, BoolArray]:
    """Return poses about the centre of their joints, keypoints, and which are usable; else 0."""
    known = np.asarray(np.isfinite(joints).all(-1))
    used = np.asarray(known & np.isfinite(x).all(-1))
    used &= used.sum(-1, keepdims=True) >= MIN_JOINTS
    Y = np.where(known[..., None], joints, 0.0)
    centre = Y.sum(1, keepdims=True) / np.maximum(known.sum(-1), 1)[:, None, None]
    Y = np.where(known[..., None], Y - centre, 0.0)
    return Y, np.where(used[..., None], x, 0.0), used


def lift(
    joints: Float64Array, x: Float64Array, *, crop: float = 0.0, steps: int = _STEPS
) -> Float64Array:
    """Place and turn monocular poses so that they project onto their keypoints.

    The position of the root is the closed-form solution of ``argmin_T sum_s |(I - b b^T)
    (Y_s + T)|^2`` with the bearings b of the keypoints; then Gauss-Newton steps on the
    robust image error for the root and a rotation that a prior keeps small.

    Parameters
    ----------
    joints : (F, J, 3) ndarray
        Y, in the axes of the optical frame, any origin, metres; NaN where unknown.
    x : (F, J, 2) ndarray
        Keypoints on the plane z = 1; NaN where not observed.
    crop : float
        Fraction of the angle off the optical axis to rotate by: see `crop_fraction`.
    steps : int
        Gauss-Newton steps.

    Returns
    -------
    (F, J, 3) ndarray
        Joints in the optical frame; NaN for frames with fewer than six usable joints or
        with a person that would be behind the camera.
    """
    known = np.asarray(np.isfinite(joints).all(-1))
    Y, target, used = _centred(joints, x)
    enough = used.any(-1)
    if crop:
        Y = _undo_crop(Y, target, used, crop)
    root, solved = _place(Y, target, used)
    for _ in range(steps):
        Y, root = _turn(Y, root, target, used)
    ahead = (Y[..., 2] + root[:, None, 2] > NEAREST_M) | ~used
    good = enough & solved & ahead.all(-1)
    return np.where((good[:, None] & known)[..., None], Y + root[:, None], np.nan)


def _place(Y: Float64Array, x: Float64Array, used: BoolArray) -> tuple[Float64Array, BoolArray]:
    b = unit_rays(x)
    P = used[..., None, None] * (np.eye(3) - b[..., :, None] * b[..., None, :])
    A = P.sum(1)
    rhs = -np.einsum("fjab,fjb->fa", P, Y)
    good = np.linalg.det(A) > MIN_DETERMINANT
    root = np.linalg.solve(np.where(good[:, None, None], A, np.eye(3)), rhs[..., None])[..., 0]
    return root, good & (root[:, 2] > NEAREST_M)


def _turn(
    Y: Float64Array, root: Float64Array, x: Float64Array, used: BoolArray
) -> tuple[Float64Array, Float64Array]:
    """One Gauss-Newton step for the root and a small rotation of the pose about it."""
    X = Y + root[:, None]
    depth = np.maximum(X[..., 2], NEAREST_M)
    residual = X[..., :2] / depth[..., None] - x
    weight = used / (1.0 + (residual**2).sum(-1) / KEYPOINT_SCALE**2)
    J_X = np.zeros((*Y.shape[:2], 2, 3))
    J_X[..., 0, 0] = J_X[..., 1, 1] = 1.0 / depth
    J_X[..., :, 2] = -X[..., :2] / depth[..., None] ** 2
    J_omega = J_X @ np.swapaxes(hat(Y), -1, -2)
    J = np.concatenate([J_omega, J_X], -1).reshape(len(Y), 2 * Y.shape[1], 6)
    weighted = np.swapaxes(J * np.repeat(weight, 2, axis=1)[..., None], -1, -2)
    H = weighted @ J
    H[:, range(3), range(3)] += ROTATION_PRIOR
    H[:, range(6), range(6)] += 1e-9
    g = weighted @ residual.reshape(len(Y), 2 * Y.shape[1], 1)
    step = -np.linalg.solve(H, g)[..., 0]
    omega = step[:, :3]
    length = np.linalg.norm(omega, axis=-1, keepdims=True)
    omega = omega * np.minimum(1.0, MAX_ROTATION / np.maximum(length, 1e-12))
    return Y @ np.swapaxes(exp_so3(omega), -1, -2), root + step[:, 3:]
