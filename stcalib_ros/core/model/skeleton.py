"""The joints and bone directions that all cameras of a recording have in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.keypoint_layouts import DETAILS, Layout, layout_from_names
from stcalib_ros.core.model.recording import Recording

_SIDES = ("left", "right")
_MIN_DIRECTIONS = 4
"""Count. Layouts with fewer bones and body lines in common are refused: they do not determine the
rotation of a body. Chosen."""
ADULT_HEIGHT_M = 1.72
"""Metres. Height of the adult whose limbs are the measure of all sizes. Chosen."""
_ADULT_LENGTHS = {
    f"{side}_{bone.replace(' ', f' {side}_')}": length
    for side in _SIDES
    for bone, length in {
        "hip knee": 0.43,
        "knee ankle": 0.42,
        "shoulder elbow": 0.29,
        "elbow wrist": 0.25,
    }.items()
} | {"torso": 0.50}
"""Metres. Segment lengths of an adult of 1.72 m, for lifters that give poses up to scale: thigh
0.245, shank 0.246, upper arm 0.17 (0.186 to the shoulder), forearm 0.146, trunk 0.288 of the height
(R. Drillis and R. Contini, 1966; D. A. Winter, "Biomechanics and motor control of human movement",
2009), by what common layouts take for hips and shoulders."""


@dataclass(frozen=True, slots=True, eq=False)
class Skeleton:
    """Working joints and oriented points (Section III-A) of a recording.

    Attributes
    ----------
    layout : Layout
        The J joints that every camera gives.
    columns : tuple of (J,) ndarray of int
        Indices of these joints in the layout of each camera.
    directions : (D, J) ndarray
        Rows that turn joints into bone vectors: bones, hip line, shoulder line, torso.
    adult_lengths : (D,) ndarray
        Length of these vectors in an adult, metres; NaN where it differs between layouts.
    """

    layout: Layout
    columns: tuple[IntArray, ...]
    directions: Float64Array
    adult_lengths: Float64Array


def common_skeleton(recording: Recording) -> Skeleton:
    """Return the joints and directions that all cameras have in common, without `DETAILS`.

    Raises
    ------
    InputError
        Two cameras have layouts with too few joint names in common.
    """
    layouts = [camera.layout for camera in recording.cameras]
    layout = layouts[0]
    shared = set.intersection(*(set(one.joint_names) for one in layouts)) - DETAILS
    if any(set(one.joint_names) != shared for one in layouts):
        layout = layout_from_names([n for n in layout.joint_names if n in shared], name="common")
    directions, names = bone_vectors(layout)
    if len(directions) < _MIN_DIRECTIONS:
        given = ", ".join(f"{c.name}: {c.layout.name}" for c in recording.cameras)
        raise InputError(
            f"the layouts ({given}) have only {layout.n_joints} joints and {len(directions)} bones "
            "in common: use layouts whose joint_names agree, with the names that built-in layouts "
            "have (left_hip, left_knee, ...)"
        )
    columns = tuple(
        np.array([one.index(name) for name in layout.joint_names], dtype=np.int64)
        for one in layouts
    )
    return Skeleton(layout, columns, directions, _adult_lengths(names))


def body_bones(layout: Layout) -> tuple[Float64Array, Float64Array]:
    """Return the bone vectors (D, J) of a layout, and their lengths (D,) in an adult.

    They are those of a `Skeleton` of this layout alone.
    """
    directions, names = bone_vectors(layout)
    return directions, _adult_lengths(names)


def _adult_lengths(names: Sequence[str]) -> Float64Array:
    return np.array([_ADULT_LENGTHS.get(name, np.nan) for name in names])


def mirrored_joints(layout: Layout) -> IntArray:
    """Return the index (J,) of the joint of the other side; of joints without a side their own."""
    names = layout.joint_names
    other = {"left": "right", "right": "left"}
    opposite = ["_".join(other.get(word, word) for word in name.split("_")) for name in names]
    return np.array([names.index(o) if o in names else j for j, o in enumerate(opposite)])


def bone_vectors(layout: Layout) -> tuple[Float64Array, tuple[str, ...]]:
    """Rows (D, J) that make bone vectors of the joints of a layout, and their names.

    Every bone (parent to joint, named "parent joint"), and where the joints are there the
    lines "hips" and "shoulders" and the "torso" between the two middles.
    """
    joints = layout.joint_names
    unit = np.eye(layout.n_joints)
    rows = {
        f"{joints[p]} {joints[j]}": unit[j] - unit[p]
        for j, p in enumerate(layout.parents)
        if p >= 0
    }
    hips, shoulders = (_pair(layout, joint) for joint in ("hip", "shoulder"))
    rows |= {n: unit[p[0]] - unit[p[1]] for n, p in (("hips", hips), ("shoulders", shoulders)) if p}
    if hips and shoulders:
        rows["torso"] = (unit[shoulders].sum(0) - unit[hips].sum(0)) / 2.0
    return np.array(list(rows.values())).reshape(-1, layout.n_joints), tuple(rows)


def _pair(layout: Layout, joint: str) -> list[int]:
    names = [f"{side}_{joint}" for side in _SIDES]
    return [layout.index(n) for n in names] if set(names) <= set(layout.joint_names) else []
