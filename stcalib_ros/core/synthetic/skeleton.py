"""The simulated body: 17 joints in Human3.6M's order, as bone directions and bone lengths."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS

LAYOUT = LAYOUTS["h36m_17"]
"""Layout of all simulated people."""

PARENTS = LAYOUT.parents
N_JOINTS = LAYOUT.n_joints

_LENGTHS = {
    "hip": 0.105,
    "knee": 0.42,
    "ankle": 0.41,
    "spine": 0.23,
    "thorax": 0.25,
    "neck": 0.1,
    "head": 0.14,
    "shoulder": 0.18,
    "elbow": 0.28,
    "wrist": 0.26,
}
"""Distance of a joint from its parent in a person of 1.72 m, metres."""

_KIND = tuple(n.removeprefix("left_").removeprefix("right_") for n in LAYOUT.joint_names)

MIRROR = np.array(
    [
        LAYOUT.index(
            n.replace("left_", "right_") if n.startswith("left_") else n.replace("right_", "left_")
        )
        for n in LAYOUT.joint_names
    ]
)
"""Joint that takes a joint's place when left and right are exchanged."""


def standard_lengths() -> Float64Array:
    """Bone lengths (17,) of the procedural body, metres; the root's is 0."""
    return np.array([0.0] + [_LENGTHS[kind] for kind in _KIND[1:]])


def individual_lengths(rng: np.random.Generator, lengths: Float64Array) -> Float64Array:
    """Bone lengths of somebody else: another size and other proportions, left as right."""
    size = rng.uniform(0.92, 1.12)
    factor = {kind: 1.0 + 0.04 * rng.standard_normal() for kind in dict.fromkeys(_KIND)}
    return np.asarray(lengths * size * np.array([factor[kind] for kind in _KIND]))


def bones_of(joints: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Compute unit bone directions (..., 17, 3), the root's zero, and mean bone lengths (17,)."""
    bones = joints - joints[..., np.maximum(PARENTS, 0), :]
    length = np.linalg.norm(bones, axis=-1)
    unit = bones / np.maximum(length, 1e-9)[..., None]
    return unit, length.reshape(-1, N_JOINTS).mean(axis=0)


def assemble(root: Float64Array, directions: Float64Array, lengths: Float64Array) -> Float64Array:
    """Joints (..., 17, 3) from root (..., 3), bone directions (of any length) and bone lengths."""
    norm = np.linalg.norm(directions, axis=-1, keepdims=True)
    bones: Float64Array = directions / np.maximum(norm, 1e-9) * lengths[:, None]
    joints = np.empty_like(bones)
    joints[..., 0, :] = root
    for joint in range(1, N_JOINTS):
        joints[..., joint, :] = joints[..., PARENTS[joint], :] + bones[..., joint, :]
    return joints


def body_axes(joints: Float64Array) -> Float64Array:
    """Axes of the trunk (..., 3, 3): rows forward, left, up in the frame of the joints."""
    left = joints[..., LAYOUT.index("left_hip"), :] - joints[..., LAYOUT.index("right_hip"), :]
    up = joints[..., LAYOUT.index("thorax"), :] - joints[..., LAYOUT.index("pelvis"), :]
    up = up / np.linalg.norm(up, axis=-1, keepdims=True)
    left = left - np.sum(left * up, axis=-1, keepdims=True) * up
    left = left / np.linalg.norm(left, axis=-1, keepdims=True)
    return np.stack([np.cross(left, up), left, up], axis=-2)
