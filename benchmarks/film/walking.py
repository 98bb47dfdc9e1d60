"""People who walk: paths, the gait of a motion capture clip, and the pose of every bone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from benchmarks.film.figures import BONE_NAMES, BONE_PARENTS, LANDMARK_BONES, Figure
from benchmarks.film.meshes import units
from stcalib_ros.core.geometry.so3 import exp_so3, log_so3
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.synthetic.clips import CyclicClip
from stcalib_ros.core.synthetic.gait import ProceduralMotion
from stcalib_ros.core.synthetic.paths import GroundPaths
from stcalib_ros.core.synthetic.skeleton import LAYOUT, N_JOINTS, bones_of, standard_lengths

_SMOOTH_S = 0.03
"""Seconds. Standard deviation over which heights of the lowest point of the shoes are smoothed."""
_OF_FOOT = 0.5
"""Weight of the bones of a foot from which on a vertex counts as the foot's: most of it."""
_TOES_UP = 0.6
"""Fraction of the shank's backward lean by which the toes are raised: less, feet land flat."""
_LOOK = 0.6
"""Fraction by which a head is turned from the chest towards the way ahead. Chosen."""

_LIMBS = {
    "thigh": ("hip", "knee"),
    "calf": ("knee", "ankle"),
    "upperarm": ("shoulder", "elbow"),
    "lowerarm": ("elbow", "wrist"),
}
"""Joints between which a bone lies."""


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Bones of one person at T times.

    Attributes
    ----------
    R_world_bone : (T, B, 3, 3) ndarray
        Rotation of every bone from rest.
    heads : (T, B, 3) ndarray
        First ends of the bones in the world, metres.
    """

    R_world_bone: Float64Array
    heads: Float64Array


class Walker:
    """A figure that walks along a path.

    Parameters
    ----------
    figure : Figure
    body : CyclicClip or ProceduralMotion
        The gait.
    times : (T,) ndarray
        Evenly spaced seconds, at which the paths are given.
    paths : GroundPaths
    person : int
        Which of the paths.
    """

    def __init__(
        self,
        figure: Figure,
        body: CyclicClip | ProceduralMotion,
        times: Float64Array,
        paths: GroundPaths,
        person: int,
    ) -> None:
        self.figure = figure
        sole = [k for k, name in enumerate(BONE_NAMES) if name.startswith(("ball", "foot"))]
        self._feet = np.flatnonzero(figure.weights[:, sole].sum(axis=1) > _OF_FOOT)
        local = body.joints(times, paths.travelled[:, person], _lengths(figure))
        heading = paths.heading[:, person]
        turn = np.zeros((len(times), 3))
        turn[:, 2] = heading
        R_world_body = exp_so3(turn)
        joints = np.einsum("tab,tjb->tja", R_world_body, local)
        joints[..., :2] += paths.xy[:, person, None]
        self._joints = CubicSpline(times, joints.reshape(len(times), -1))
        self._heading = CubicSpline(times, heading)
        self._lift = CubicSpline(times, np.zeros(len(times)))
        lowest = self._lowest(times)
        step = float(times[1] - times[0])
        self._lift = CubicSpline(times, gaussian_filter1d(-lowest, _SMOOTH_S / step))

    def pose(self, times: Float64Array) -> Pose:
        """Return the bones at times of the reference clock, seconds."""
        joints = np.asarray(self._joints(times)).reshape(len(times), N_JOINTS, 3)
        R = self._rotations(joints, np.asarray(self._heading(times)))
        heads = np.empty((len(times), len(BONE_NAMES), 3))
        heads[:, 0] = joints[:, 0]
        heads[:, 0, 2] += self._lift(times)
        for bone, parent in enumerate(BONE_PARENTS):
            if parent >= 0:
                offset = self.figure.heads[bone] - self.figure.heads[parent]
                heads[:, bone] = heads[:, parent] + R[:, parent] @ offset
        return Pose(R, heads)

    def landmarks(self, times: Float64Array) -> Float64Array:
        """Return the keypoints (T, 17, 3) of coco_17 in the world, metres."""
        pose = self.pose(times)
        out = []
        for name, bone_name in LANDMARK_BONES.items():
            bone = BONE_NAMES.index(bone_name)
            offset = self.figure.landmarks[name] - self.figure.heads[bone]
            out.append(pose.heads[:, bone] + pose.R_world_bone[:, bone] @ offset)
        return np.stack(out, axis=1)

    def ankles(self, times: Float64Array) -> Float64Array:
        """Return both ankles (T, 2, 3) in the world, metres."""
        return self.pose(times).heads[:, [BONE_NAMES.index(f"foot_{side}") for side in "lr"]]

    def _lowest(self, times: Float64Array) -> Float64Array:
        """Height (T,) of the lowest point of the feet."""
        chunks = np.array_split(times, max(1, len(times) // 100))
        return np.concatenate(
            [skinned(self.figure, self.pose(t), self._feet)[..., 2].min(axis=1) for t in chunks]
        )

    def _rotations(self, joints: Float64Array, heading: Float64Array) -> Float64Array:
        bones, rest = bones_of(joints)[0], self.figure
        R = np.empty((len(joints), len(BONE_NAMES), 3, 3))

        def put(name: str, value: Float64Array) -> None:
            R[:, BONE_NAMES.index(name)] = value

        left = units(joints[:, LAYOUT.index("left_hip")] - joints[:, LAYOUT.index("right_hip")])
        pelvis = _axes(left, bones[:, LAYOUT.index("spine")])
        left = units(
            joints[:, LAYOUT.index("left_shoulder")] - joints[:, LAYOUT.index("right_shoulder")]
        )
        chest = _axes(left, bones[:, LAYOUT.index("thorax")])
        ahead = exp_so3(heading[:, None] * np.array([0.0, 0.0, 1.0]))
        for share, name in enumerate(("pelvis", "spine_01", "spine_02", "spine_03")):
            put(name, _between(pelvis, chest, share / 3))
        put("neck_01", _between(chest, ahead, 0.5 * _LOOK))
        put("head", _between(chest, ahead, _LOOK))
        for side, short in (("left", "l"), ("right", "r")):
            put(f"clavicle_{short}", chest)
            for limb, (upper, lower) in _LIMBS.items():
                bone = BONE_NAMES.index(f"{limb}_{short}")
                at_rest = rest.landmarks[f"{side}_{lower}"] - rest.landmarks[f"{side}_{upper}"]
                R_parent = R[:, BONE_PARENTS[bone]]
                now = bones[:, LAYOUT.index(f"{side}_{lower}")]
                put(f"{limb}_{short}", _aligning(R_parent @ units(at_rest), now) @ R_parent)
            put(f"hand_{short}", R[:, BONE_NAMES.index(f"lowerarm_{short}")])
            foot = _foot(R[:, BONE_NAMES.index(f"calf_{short}")], ahead)
            put(f"foot_{short}", foot)
            put(f"ball_{short}", foot)
        return R


def skinned(
    figure: Figure, pose: Pose, source: IntArray, rest: Float64Array | None = None
) -> Float64Array:
    """Return points (T, N, 3) of the surface in the world.

    Parameters
    ----------
    figure : Figure
    pose : Pose
    source : (N,) ndarray of int
        Vertices of the figure that the points go with.
    rest : (N, 3) ndarray, optional
        Where the points are at rest. Default: the vertices.
    """
    rest = figure.vertices[source] if rest is None else rest
    R, weights = pose.R_world_bone, figure.weights[source]
    shift = pose.heads - np.einsum("tbij,bj->tbi", R, figure.heads)
    blended = np.einsum("nb,tbk->tnk", weights, R.reshape(*R.shape[:2], 9), optimize=True)
    moved = np.einsum("nb,tbk->tnk", weights, shift, optimize=True)
    turned = blended.reshape(*blended.shape[:2], 3, 3) @ rest[:, :, None]
    return np.asarray(turned[..., 0] + moved)


def _foot(R_world_calf: Float64Array, R_world_ahead: Float64Array) -> Float64Array:
    """Return the rotation of a foot: as its shank, but with less of the toes up."""
    forward = R_world_calf[:, :, 0]
    ahead = R_world_ahead[:, :, 0]
    level = units(forward * [1, 1, 0] + 1e-6 * ahead)
    pitch = np.arctan2(forward[:, 2], np.linalg.norm(forward[:, :2], axis=-1))
    pitch = np.where(pitch > 0, _TOES_UP * pitch, pitch)
    up = np.array([0.0, 0.0, 1.0])
    x = np.cos(pitch)[:, None] * level + np.sin(pitch)[:, None] * up
    y = np.cross(np.broadcast_to(up, level.shape), level)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def _lengths(figure: Figure) -> Float64Array:
    """Return bone lengths (17,) of a figure in Human3.6M's order; those of the trunk do not act."""
    lengths = standard_lengths()
    for side in ("left", "right"):
        for upper, lower in _LIMBS.values():
            between = figure.landmarks[f"{side}_{lower}"] - figure.landmarks[f"{side}_{upper}"]
            lengths[LAYOUT.index(f"{side}_{lower}")] = np.linalg.norm(between)
    return lengths


def _axes(left: Float64Array, up: Float64Array) -> Float64Array:
    """Rotation (T, 3, 3) with columns forward, left, up; left is kept."""
    forward = units(np.cross(left, up))
    return np.stack([forward, left, np.cross(forward, left)], axis=-1)


def _between(A: Float64Array, B: Float64Array, share: float) -> Float64Array:
    return A @ exp_so3(share * log_so3(np.swapaxes(A, -1, -2) @ B))


def _aligning(a: Float64Array, b: Float64Array) -> Float64Array:
    """Return the smallest rotations (T, 3, 3) from unit vectors a to unit vectors b."""
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(sine, np.sum(a * b, axis=-1, keepdims=True))
    return exp_so3(axis / np.maximum(sine, 1e-9) * angle)
