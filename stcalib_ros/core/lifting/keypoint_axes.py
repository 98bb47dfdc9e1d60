"""Keypoints whose x and y, or whose joints, are in another order than they are said to be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stcalib_ros.core.lifting.limits import (
    MAX_OUTSIDE_IF_SWAPPED,
    MAX_PROPORTIONS,
    MIN_LYING,
    MIN_OUTSIDE,
    MIN_SAMPLED_POSES,
    ORDER_MARGIN,
)
from stcalib_ros.core.lifting.pose_axes import pose_axes
from stcalib_ros.core.lifting.read_camera import ReadCamera
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, FloatArray
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS, TRUNK_JOINTS, Layout
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.core.model.rejection import Remark, RemarkCode
from stcalib_ros.core.model.skeleton import body_bones

_MAX_POSES = 200
"""Poses of a camera that are looked at, about. Numerical: bounds the cost."""
_FACING = 0.8
"""Quantile, over poses, of the length of a limb in the image: that at which it is seen from the
side. Chosen."""
_UPRIGHT_DEG = 60.0
"""Degrees. An image is turned if people's trunks are further from its vertical, on average. Chosen:
nearer to a quarter turn than to none; cameras are hung with a roll of a few degrees. Measured: 81
and 85 degrees of two of the webcams of "desk", which lie on their sides by its truth."""
_ALIKE = 0.8
"""Length of the mean of unit vectors along the trunks. With less, people lean in all directions, as
below a camera at the ceiling. Derived: 0.8 is a scatter of 37 degrees; 0.99 on "desk"."""
_SWAPPED = ((1, 1), (0, 1))
"""Axes of 3D poses that are right and down in the image where x and y of its points are swapped."""


def with_own_layout(camera: CameraRecording, *, min_score: float) -> ReadCamera:
    """Return a camera with the layout in whose order its joints are, by the proportions of limbs.

    Parameters
    ----------
    camera : CameraRecording
    min_score : float
        Joints with a lower score are not looked at.
    """
    layout = camera.layout
    others = [
        other
        for other in LAYOUTS.values()
        if other.n_joints == layout.n_joints and other.joint_names != layout.joint_names
    ]
    if not others or layout.joint_names != getattr(LAYOUTS.get(layout.name), "joint_names", None):
        return ReadCamera(camera)
    points = _some_points(camera, min_score)
    if len(points) < MIN_SAMPLED_POSES:
        return ReadCamera(camera)
    given = disproportion(points, layout)
    if not given > MAX_PROPORTIONS:
        return ReadCamera(camera)
    best = min(others, key=lambda other: disproportion(points, other))
    if not disproportion(points, best) < ORDER_MARGIN * given:
        return ReadCamera(camera)
    remark = Remark(RemarkCode.LAYOUT_MISTAKEN, (camera.name,), detail=best.name)
    return ReadCamera(replace(camera, layout=best), (remark,))


def disproportion(points: Float64Array, layout: Layout) -> float:
    """Return by how much the limbs are longer or shorter than those of an adult, to each other.

    Parameters
    ----------
    points : (F, J, 2) ndarray
        Keypoints, px; NaN where not observed.
    layout : Layout

    Returns
    -------
    float
        Standard deviation of the logarithm of the ratio, over limbs as they are seen from the side;
        infinite where fewer than half of them are seen.
    """
    rows, lengths = body_bones(layout)
    limbs = np.flatnonzero(np.isfinite(lengths))
    bones = np.einsum("dj,fjk->fdk", rows[limbs], np.nan_to_num(points))
    missing = (rows[limbs] != 0).astype(float) @ (~np.isfinite(points[..., 0])).T.astype(float)
    side = np.fmax(*(np.fmax.reduce(points, axis=1) - np.fmin.reduce(points, axis=1)).T)
    length = np.linalg.norm(bones, axis=-1) / np.maximum(side, 1e-9)[:, None]
    seen = np.where(missing.T > 0, np.nan, length)
    enough = np.isfinite(seen).sum(0) >= MIN_SAMPLED_POSES
    if not len(limbs) or 2 * enough.sum() < len(limbs):
        return float("inf")
    facing = np.nanquantile(seen[:, enough], _FACING, axis=0)
    return float(np.std(np.log(np.maximum(facing, 1e-9) / lengths[limbs][enough])))


def with_x_before_y(camera: CameraRecording, *, min_score: float) -> ReadCamera:
    """Return a camera with the coordinates of its keypoints exchanged where they are swapped.

    That is so where people lie, and either their 3D poses stand, or their keypoints are outside of
    the image as they are, and within it if they are exchanged.

    Parameters are those of `with_own_layout`.
    """
    points = _some_points(camera, min_score)
    if len(points) < MIN_SAMPLED_POSES or not _lying(points, camera.layout) > MIN_LYING:
        return ReadCamera(camera)
    size = np.array([camera.intrinsics.width, camera.intrinsics.height])
    outside, if_swapped = _outside(points, size), _outside(points[..., ::-1], size)
    by_size = outside > MIN_OUTSIDE and if_swapped < MAX_OUTSIDE_IF_SWAPPED * outside
    if not by_size and not _poses_stand(camera, min_score):
        return ReadCamera(camera)
    tracks = tuple(replace(t, keypoints=t.keypoints[..., ::-1]) for t in camera.tracks)
    remark = Remark(RemarkCode.KEYPOINTS_SWAPPED, (camera.name,))
    return ReadCamera(replace(camera, tracks=tracks), (remark,))


def _poses_stand(camera: CameraRecording, min_score: float) -> bool:
    """Whether 3D poses project onto the keypoints if their x is down and their y is right."""
    read = pose_axes(camera, min_score=min_score)
    return read is not None and read.axes is not None and read.axes[:2] == _SWAPPED


def turned_images(recording: Recording, *, min_score: float) -> tuple[Remark, ...]:
    """Return in which images people do not stand upright: they are turned by a quarter or by half.

    Parameters
    ----------
    recording : Recording
    min_score : float
        Joints with a lower score are not looked at.
    """
    remarks = []
    for camera in recording.cameras:
        trunk = _trunks(_some_points(camera, min_score), camera.layout)
        if len(trunk) < MIN_SAMPLED_POSES:
            continue
        right, down = trunk.mean(0)
        turned_deg = float(np.degrees(np.arctan2(right, down)))
        if np.hypot(right, down) > _ALIKE and abs(turned_deg) > _UPRIGHT_DEG:
            values = {"turned_deg": 90.0 * abs(round(turned_deg / 90.0))}
            remarks.append(Remark(RemarkCode.IMAGE_NOT_UPRIGHT, (camera.name,), values))
    return tuple(remarks)


def _lying(points: Float64Array, layout: Layout) -> float:
    """Return how far hips are beside shoulders, to the right, over the length of the trunk."""
    along = _trunks(points, layout)[:, 0]
    return float(np.median(along)) if len(along) else 0.0


def _trunks(points: Float64Array, layout: Layout) -> Float64Array:
    """Directions (K, 2) from the shoulders to the hips, of poses that have both."""
    at = {name: points[:, j] for j, name in enumerate(layout.joint_names)}
    if not set(TRUNK_JOINTS) <= set(at):
        return np.zeros((0, 2))
    left_hip, right_hip, left_shoulder, right_shoulder = (at[name] for name in TRUNK_JOINTS)
    trunk = left_hip + right_hip - left_shoulder - right_shoulder
    along = trunk / np.maximum(np.linalg.norm(trunk, axis=-1), 1e-9)[:, None]
    return np.asarray(along[np.isfinite(along).all(-1)])


def _outside(points: Float64Array, size: FloatArray) -> float:
    """Return the fraction of keypoints beyond the right or lower border of the image."""
    known = points[np.isfinite(points).all(-1)]
    return float(np.mean((known > size).any(-1))) if len(known) else 0.0


def _some_points(camera: CameraRecording, min_score: float) -> Float64Array:
    """Return the keypoints (F, J, 2) of some poses; NaN where not observed."""
    stride = max(1, sum(len(track.frames) for track in camera.tracks) // _MAX_POSES)
    some = [np.zeros((0, camera.layout.n_joints, 2))]
    for track in camera.tracks:
        scored = (track.scores[::stride] >= min_score)[..., None]
        some.append(np.where(scored, track.keypoints[::stride], np.nan))
    points = np.concatenate(some).astype(np.float64)
    known: BoolArray = np.asarray(np.isfinite(points[..., 0]))
    return points[known.any(1)]
