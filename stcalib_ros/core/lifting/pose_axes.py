"""Whether the 3D poses of a camera project onto its own keypoints; if not, which axes they have.

Seen from far away, keypoints are two of the coordinates of a pose, moved and scaled. Of poses in
the axes of the optical frame these are x and y; of others another two, or the sides of the body are
exchanged, or the joints are in another order. The third axis does not show in the image, but in the
bodies: knees bend forward, and with one axis reversed they bend backward.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from stcalib_ros.core.geometry.lens import bearings
from stcalib_ros.core.lifting.limits import (
    AXES_MARGIN,
    MIN_COMMON_NAMES,
    MIN_HANDEDNESS,
    MIN_JOINTS,
    MIN_PROJECTION,
    MIN_SAMPLED_POSES,
    SURE_PROJECTION,
)
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.keypoint_layouts import DETAILS, LAYOUTS, Layout
from stcalib_ros.core.model.recording import CameraRecording, without_3d_poses
from stcalib_ros.core.model.rejection import Remark, RemarkCode
from stcalib_ros.core.model.skeleton import mirrored_joints

_MAX_POSES = 100
"""Poses of a camera that are looked at, about. Numerical: bounds the cost."""
_DIRECTIONS = (("left", "right"), ("up", "down"), ("backward", "forward"))
"""Negative and positive direction of each axis of an optical frame."""
_OTHER_CAUSE = 0.02
"""Correlation by which exchanged sides or another order of joints have to fit better than axes
alone, which are the simpler cause. Chosen."""
_HINGES = (
    ("hip", "knee", "ankle", 1.0),
    ("shoulder", "elbow", "wrist", -1.0),
    ("ear", "nose", "ear", 1.0),
    ("ankle", "big_toe", "ankle", 1.0),
    ("ankle", "foot_index", "ankle", 1.0),
    ("ankle", "foot", "ankle", 1.0),
)
"""Joints that are ahead of (1) or behind (-1) the line between two others, by the side."""


@dataclass(frozen=True, slots=True)
class PoseAxes:
    """How the 3D poses of a camera have to be read so that they project onto its keypoints.

    Attributes
    ----------
    given : float
        Correlation of keypoints with x and y of the poses as they are.
    best : float
        The largest correlation of any way to read them.
    axes : tuple of (int, int), or None
        For right, down and forward: which axis of the poses it is, and with which sign. None
        where no way fits, or only another one than other axes.
    sides_exchanged : bool
        Left and right have to be exchanged.
    layout : str
        The layout in whose order the joints are; empty if it is their own.
    """

    given: float
    best: float
    axes: tuple[tuple[int, int], ...] | None = None
    sides_exchanged: bool = False
    layout: str = ""

    @property
    def words(self) -> str:
        """The axes of the poses in words; empty if there are none that fit."""
        if self.axes is None:
            return ""
        words = [""] * len("xyz")
        for direction, (axis, sign) in zip(_DIRECTIONS, self.axes, strict=True):
            words[axis] = f"{'xyz'[axis]} {direction[sign > 0]}"
        return ", ".join(words)


@dataclass(frozen=True, slots=True, eq=False)
class _Variant:
    """One way to read the joints: the column (J,) of each in the poses, -1: none."""

    columns: IntArray
    sides_exchanged: bool = False
    layout: str = ""


def with_projecting_poses(
    camera: CameraRecording, *, min_score: float
) -> tuple[CameraRecording, tuple[Remark, ...]]:
    """Return a camera without its 3D poses where these do not project onto its keypoints.

    Parameters are those of `pose_axes`.
    """
    read = pose_axes(camera, min_score=min_score)
    if read is None:
        return camera, ()
    code, detail = RemarkCode.POSES_DO_NOT_PROJECT, ""
    if read.layout:
        code, detail = RemarkCode.POSES_IN_OTHER_ORDER, read.layout
    elif read.sides_exchanged:
        code = RemarkCode.POSES_WITH_SIDES_EXCHANGED
    elif read.axes is not None:
        code, detail = RemarkCode.POSES_IN_OTHER_AXES, read.words
    values = {"given": read.given, "best": read.best}
    return without_3d_poses(camera), (Remark(code, (camera.name,), values, detail),)


def pose_axes(camera: CameraRecording, *, min_score: float) -> PoseAxes | None:
    """Return how the 3D poses of a camera have to be read, unless as they are given.

    Parameters
    ----------
    camera : CameraRecording
    min_score : float
        Joints with a lower score are not looked at.

    Returns
    -------
    PoseAxes or None
        None where the poses project onto the keypoints, or where there are too few.
    """
    joints, x = _samples(camera, min_score)
    if len(joints) < MIN_SAMPLED_POSES:
        return None
    given = _correlations(joints, x)
    plain = float(given[_VIEWS.index(_IDENTITY)])
    hand = handedness(joints, camera.layout)
    mirrored = PoseAxes(plain, plain, (*_IDENTITY, (2, -1))) if hand < -MIN_HANDEDNESS else None
    if plain >= SURE_PROJECTION:
        return mirrored
    best, view, variant = _best(joints, x, given, camera.layout)
    if best >= SURE_PROJECTION and 1.0 - best < AXES_MARGIN * (1.0 - plain):
        read = variant.columns == np.arange(len(variant.columns))
        axes = _with_third_axis(_VIEWS[view], -hand if variant.sides_exchanged else hand)
        same = _VIEWS[view] == _IDENTITY and not read.all()
        return PoseAxes(
            plain, best, None if same else axes, variant.sides_exchanged, variant.layout
        )
    return PoseAxes(plain, best) if plain < MIN_PROJECTION else mirrored


def projection_correlation(camera: CameraRecording, *, min_score: float) -> float:
    """Return the correlation of keypoints with x and y of the 3D poses as they are given.

    NaN where there are too few poses to say so. Parameters are those of `pose_axes`.
    """
    joints, x = _samples(camera, min_score)
    if len(joints) < MIN_SAMPLED_POSES:
        return float("nan")
    return float(_correlations(joints, x)[_VIEWS.index(_IDENTITY)])


_View = tuple[tuple[int, int], tuple[int, int]]
_VIEWS: tuple[_View, ...] = tuple(
    ((right, s), (down, t))
    for right, down in permutations(range(3), 2)
    for s, t in product((1, -1), repeat=2)
)
"""Axis and sign of the coordinates that are right and down in the image."""
_IDENTITY: _View = ((0, 1), (1, 1))
"""That of poses in the axes of the optical frame."""


def handedness(joints: Float64Array, layout: Layout) -> float:
    """Return whether bodies bend the way that they can: 1 if all do, -1 in a mirror.

    Parameters
    ----------
    joints : (F, J, 3) ndarray
        In right-handed axes; NaN where unknown.
    layout : Layout

    Returns
    -------
    float
        Knees, elbows, noses and toes on the side of their line on which they belong, less those on
        the other, weighted by their distance from it; zero where the layout does not say.
    """
    at = {name: joints[:, j] for j, name in enumerate(layout.joint_names)}
    trunk = [f"{side}_{part}" for side in ("left", "right") for part in ("hip", "shoulder")]
    if not set(trunk) <= set(at):
        return 0.0
    hip_l, shoulder_l, hip_r, shoulder_r = (at[name] for name in trunk)
    left, up = hip_l + shoulder_l - hip_r - shoulder_r, shoulder_l + shoulder_r - hip_l - hip_r
    forward = np.cross(left, up)
    ahead = []
    for side in ("left", "right"):
        for a, b, c, sign in _HINGES:
            names = [b if b == "nose" else f"{side}_{b}", f"{side}_{a}"]
            names.append(f"{'right' if a == c == 'ear' and side == 'left' else side}_{c}")
            if set(names) <= set(at):
                middle, one, other = (at[name] for name in names)
                ahead.append(sign * ((middle - (one + other) / 2.0) * forward).sum(-1))
    known = np.array(ahead)[np.isfinite(ahead)] if ahead else np.zeros(0)
    return float(known.sum() / max(np.abs(known).sum(), 1e-12))


def _samples(camera: CameraRecording, min_score: float) -> tuple[Float64Array, Float64Array]:
    """Return some 3D poses (F, J, 3) and their keypoints (F, J, 2) on the plane z = 1.

    Joints are about their mean, NaN where one of both is not known.
    """
    layout = camera.layout
    n_poses = sum(len(track.frames) for track in camera.tracks)
    stride = max(1, n_poses // _MAX_POSES)
    joints, pixels = [np.zeros((0, layout.n_joints, 3))], [np.zeros((0, layout.n_joints, 2))]
    for track in camera.tracks:
        scored = (track.scores[::stride] >= min_score)[..., None]
        joints.append(track.joints[::stride].astype(np.float64))
        pixels.append(np.where(scored, track.keypoints[::stride], np.nan))
    Y, K = np.concatenate(joints), np.concatenate(pixels)
    known_joints = np.isfinite(Y).all(-1) & np.isfinite(K).all(-1)
    some: BoolArray = known_joints & np.array([name not in DETAILS for name in layout.joint_names])
    rows = some.sum(1) >= MIN_JOINTS
    known = some[rows][..., None]
    x, _ = bearings(K[rows], camera.intrinsics)
    return np.where(known, Y[rows], np.nan), np.where(known, x, np.nan)


def _centred(values: Float64Array, used: BoolArray) -> Float64Array:
    """Return points (F, J, k) about the mean of those used; else zero."""
    known = used[..., None]
    mean = np.where(known, values, 0.0).sum(1) / np.maximum(used.sum(1), 1)[:, None]
    return np.where(known, values - mean[:, None], 0.0)


def _correlations(joints: Float64Array, x: Float64Array) -> Float64Array:
    """Return the median correlation (V,) of keypoints with two axes of the poses, for all views."""
    used = np.asarray(np.isfinite(joints).all(-1) & np.isfinite(x).all(-1))
    Y, p = _centred(joints, used), _centred(x, used)
    M = np.swapaxes(p, -1, -2) @ Y
    size = np.sqrt((p**2).sum((1, 2)))
    spread = (Y**2).sum(1)
    found = []
    for (right, s), (down, t) in _VIEWS:
        norm = size * np.sqrt(spread[:, right] + spread[:, down])
        along = s * M[:, 0, right] + t * M[:, 1, down]
        found.append(np.median(along / np.maximum(norm, 1e-12)) if len(Y) else -1.0)
    return np.array(found)


def _best(
    joints: Float64Array, x: Float64Array, given: Float64Array, layout: Layout
) -> tuple[float, int, _Variant]:
    """Return the largest correlation of any way to read the poses, its view, and its variant."""
    view = int(np.argmax(given))
    best, variant = float(given[view]), _Variant(np.arange(layout.n_joints))
    for other in _variants(layout):
        there = other.columns >= 0
        read = np.where(there[:, None], joints[:, other.columns], np.nan)
        found = _correlations(read, x)
        k = int(np.argmax(found))
        if found[k] > best + (_OTHER_CAUSE if variant.layout == "" else 0.0):
            best, view, variant = float(found[k]), k, other
    return best, view, variant


def _variants(layout: Layout) -> list[_Variant]:
    """Return other ways to read the joints of a layout: sides exchanged, or of another layout."""
    found = [_Variant(mirrored_joints(layout), sides_exchanged=True)]
    for other in LAYOUTS.values():
        names = other.joint_names
        common = [names.index(n) if n in names else -1 for n in layout.joint_names]
        enough = sum(column >= 0 for column in common) >= MIN_COMMON_NAMES
        if other.n_joints == layout.n_joints and names != layout.joint_names and enough:
            found.append(_Variant(np.array(common), layout=other.name))
    return found


def _with_third_axis(view: _View, hand: float) -> tuple[tuple[int, int], ...]:
    """Add the axis that is forward: right-handed if bodies are, else left-handed."""
    third = 3 - view[0][0] - view[1][0]
    R = np.zeros((3, 3))
    for row, (axis, sign) in enumerate((*view, (third, 1))):
        R[row, axis] = sign
    sign = round(float(np.linalg.det(R))) * (-1 if hand < -MIN_HANDEDNESS else 1)
    return (*view, (third, sign))
