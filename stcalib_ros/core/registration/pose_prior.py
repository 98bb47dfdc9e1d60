"""What the 3D poses of matched people say about two cameras, and how well they know it.

The standard deviations are measured on the poses themselves, in two parts. Poses that turn the two
cameras differently, from person to person and from time to time, have errors of their own in each
frame. Poses that do not project onto the keypoints of their own image have errors that stay: what
is off across the optical axis will be off along it as well. Exact poses show neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.geometry.alignment import best_rotation, unit
from stcalib_ros.core.geometry.interpolation import Interpolation, frame_period
from stcalib_ros.core.geometry.so3 import log_so3, rotation_angle
from stcalib_ros.core.lifting.limits import MIN_JOINTS
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.registration.limits import (
    CONTRADICTION_RAD,
    DIRECTION_RATIO,
    MAX_ROTATION_STDDEV,
    MIN_BASELINE_M,
    SCATTER_FACTOR,
)

_BLOCKS = 8
"""Stretches of a track that count as independent samples of the errors of its poses. Numerical."""
_MAX_FRAMES = 200
"""Frames of all matched tracks that are compared, about. Numerical: bounds the cost."""
_MIN_STDDEV = 1e-6
"""rad. Standard deviations are taken to be no less. Numerical: those of exact poses are zero."""


@dataclass(frozen=True, slots=True, eq=False)
class PosePrior:
    """Relative pose of two cameras by the 3D poses of people.

    Attributes
    ----------
    R_a_b : (3, 3) ndarray
    unit_t : (3,) ndarray
        Direction of t_a_b.
    rotation_stddev : float
        Standard deviation of R_a_b about each axis, rad.
    direction_stddev : float
        Standard deviation of `unit_t` across it, rad.
    """

    R_a_b: Float64Array
    unit_t: Float64Array
    rotation_stddev: float
    direction_stddev: float

    def against(self, points_per_measurement: float) -> PosePrior:
        """Return the prior to be used with points that count as if each were a measurement."""
        factor = points_per_measurement**-0.5
        return replace(
            self,
            rotation_stddev=factor * self.rotation_stddev,
            direction_stddev=factor * self.direction_stddev,
        )

    def residuals(self, h: RelativePose) -> tuple[Float64Array, Float64Array]:
        """Residuals of rotation (3,) and direction (3,), in standard deviations."""
        turned = log_so3(h.R_a_b @ self.R_a_b.T) / self.rotation_stddev
        moved = (unit(h.t_a_b) - self.unit_t) / self.direction_stddev
        return turned, moved


def pose_prior(cameras: Sequence[LiftedCamera], h: RelativePose) -> PosePrior | None:
    """Return what the 3D poses of matched people say about a relative pose.

    The rotation is that between the bodies about their middles, the direction of t that between
    their middles, both at the lag of `h`.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    h : RelativePose
        Its lag and matches are used; its rotation says whether the poses contradict it.

    Returns
    -------
    PosePrior or None
        None where people have no 3D poses, where these say nothing, or where they contradict `h`.
    """
    common = _common_bodies(cameras, h)
    if not common:
        return None
    body_a, body_b = (np.concatenate([getattr(c, n) for c in common]) for n in ("a", "b"))
    S = body_a.reshape(-1, 3).T @ body_b.reshape(-1, 3)
    R_a_b = best_rotation(S)
    blocks = _blocks([len(c.a) for c in common])
    by_poses = _rotation_error(R_a_b, S, body_a, body_b, blocks)
    misfit = float(np.mean([c.misfit for c in common]))
    rotation = float(np.hypot(by_poses, misfit))
    away = float(rotation_angle(R_a_b.T @ h.R_a_b))
    if not (rotation < MAX_ROTATION_STDDEV and away < CONTRADICTION_RAD):
        return None
    middle_a, middle_b = (
        np.concatenate([getattr(c, n) for c in common]) for n in ("middle_a", "middle_b")
    )
    shift = middle_a - middle_b @ R_a_b.T
    t_a_b = np.median(shift, axis=0)
    if float(np.linalg.norm(t_a_b)) < MIN_BASELINE_M:
        return None
    direction = float(np.hypot(DIRECTION_RATIO * rotation, _direction_error(t_a_b, shift, blocks)))
    return PosePrior(R_a_b, unit(t_a_b), max(rotation, _MIN_STDDEV), max(direction, _MIN_STDDEV))


@dataclass(frozen=True, slots=True, eq=False)
class _Bodies:
    """Bodies (F, J, 3) of one person about their middles (F, 3), at the same times in two views.

    Joints that one of the views does not know are zero in both. `misfit` is in rad.
    """

    a: Float64Array
    b: Float64Array
    middle_a: Float64Array
    middle_b: Float64Array
    misfit: float


def _common_bodies(cameras: Sequence[LiftedCamera], h: RelativePose) -> list[_Bodies]:
    """Return the poses of all matched people that two cameras have of the same time."""
    cam_a, cam_b = cameras[h.a], cameras[h.b]
    stride = -(-sum(len(cam_a.tracks[p].frames) for p, _ in h.matches) // _MAX_FRAMES)
    period = frame_period(cam_b.stamps)
    found = []
    for p, q in h.matches:
        track_a, track_b = cam_a.tracks[p][::stride], cam_b.tracks[q]
        times = cam_a.stamps[track_a.frames] + h.lag_s
        at = Interpolation(cam_b.stamps[track_b.frames], times, period=period)
        found.append(_common(track_a, track_b, at))
    return [one for one in found if len(one.a)]


def _common(a: LiftedTrack, b: LiftedTrack, at: Interpolation) -> _Bodies:
    """Return the poses of a person in the frames of a, with those of b at these times."""
    joints_a, joints_b = a.joints_cam.astype(np.float64), at(b.joints_cam)
    both: BoolArray = np.asarray(np.isfinite(joints_a + joints_b).all(-1))
    rows = both.sum(-1) >= MIN_JOINTS
    known = both[rows, :, None]
    n = known.sum(1)
    joints = [np.where(known, one[rows], 0.0) for one in (joints_a, joints_b)]
    middle_a, middle_b = (one.sum(1) / n for one in joints)
    body_a, body_b = (
        np.where(known, one - middle[:, None], 0.0)
        for one, middle in zip(joints, (middle_a, middle_b), strict=True)
    )
    misfit_a = _misfit(joints[0], body_a, a.x[rows])
    misfit_b = _misfit(joints[1], body_b, at(b.x)[rows])
    return _Bodies(body_a, body_b, middle_a, middle_b, (misfit_a + misfit_b) / 2.0)


def _misfit(joints: Float64Array, bodies: Float64Array, x: Float64Array) -> float:
    """Distance of projected joints from their keypoints, over the size of the body (rad)."""
    distance = np.linalg.norm(joints[..., :2] - x * joints[..., 2:], axis=-1)
    observed = np.isfinite(distance) & (joints[..., 2] > 0.0)
    if not observed.any():
        return MAX_ROTATION_STDDEV
    size = float(np.sqrt((bodies[observed] ** 2).sum(-1).mean()))
    return float(np.median(distance[observed])) / max(size, 1e-9)


def _blocks(lengths: Sequence[int]) -> Float64Array:
    """Rows (K, F) that sum up stretches of successive frames of the same person."""
    begins, first = [], 0
    for n in lengths:
        begins += [first + part[0] for part in np.array_split(np.arange(n), min(_BLOCKS, n))]
        first += n
    block = np.searchsorted(begins, np.arange(first), side="right") - 1
    return np.asarray(block == np.arange(len(begins))[:, None], dtype=np.float64)


def _rotation_error(
    R_a_b: Float64Array,
    S: Float64Array,
    body_a: Float64Array,
    body_b: Float64Array,
    blocks: Float64Array,
) -> float:
    """Standard deviation (rad) of a rotation, by the scatter of what blocks of frames turn it."""
    K = len(blocks)
    if K < 2:
        return MAX_ROTATION_STDDEV
    torques = np.cross(body_b @ R_a_b.T, body_a).sum(1)
    M = R_a_b @ S.T
    inertia = np.trace(M) * np.eye(3) - (M + M.T) / 2.0
    turns = np.linalg.lstsq(inertia, (blocks @ torques).T, rcond=None)[0].T
    return float(SCATTER_FACTOR * np.sqrt(K * turns.var(0, ddof=1).sum()))


def _direction_error(t_a_b: Float64Array, shift: Float64Array, blocks: Float64Array) -> float:
    """Standard deviation (rad) of the direction of t, by the scatter of blocks of frames."""
    if len(blocks) < 2:
        return MAX_ROTATION_STDDEV
    t = unit(t_a_b)
    across = shift - np.outer(shift @ t, t)
    means = blocks @ across / blocks.sum(1, keepdims=True)
    scatter = means.var(0, ddof=1).sum() / len(blocks)
    return float(SCATTER_FACTOR * np.sqrt(scatter) / np.linalg.norm(t_a_b))
