"""The people of a calibration: their joints in 3D over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.core.reconstruction.people import _path, found_persons

if TYPE_CHECKING:
    from stcalib_ros.core.output.world_frame import WorldAlignment
    from stcalib_ros.core.stages import Stages

_LINES = (
    ("left_shoulder", "right_shoulder"),
    ("left_hip", "right_hip"),
    ("left_shoulder", "left_hip"),
    ("right_shoulder", "right_hip"),
)
"""Drawn in layouts that have no joints between hips and shoulders."""


@dataclass(frozen=True, slots=True, eq=False)
class PersonTrajectory:
    """One person's joints over time, as the adjusted cameras see them.

    Attributes
    ----------
    person_id : int
        As in `PersonAssociation`.
    layout : Layout
        Names and parents of the J joints.
    times_s : (K,) ndarray
        By the reference clock, seconds since `Recording.epoch_ns`, uniform.
    joints_ref : (K, J, 3) ndarray
        In the reference frame, in the calibration's unit; NaN where fewer than two cameras have
        image points that fit.
    """

    person_id: int
    layout: Layout
    times_s: Float64Array
    joints_ref: Float64Array


def reconstruct(stages: Stages) -> tuple[PersonTrajectory, ...]:
    """Joints of all persons of a calibration, in their order.

    Empty if there are no camera poses.
    """
    if stages.placement is None:
        return ()
    return tuple(
        _trajectory(person.person_id, stages, stages.placement, rows)
        for person, rows in zip(stages.calibration.persons, person_rows(stages), strict=True)
    )


def person_rows(stages: Stages) -> tuple[IntArray, ...]:
    """Rows of the last round's observations that show each person of the calibration."""
    if not stages.calibration.persons:
        return ()
    last = stages.rounds[-1]
    return tuple(
        np.flatnonzero(last.observations.person == number)
        for number, _ in found_persons(stages.lifted, last)
    )


def bones(layout: Layout) -> tuple[tuple[int, int], ...]:
    """Pairs of joints to draw a line between: every bone, and the trunk where it has none."""
    pairs = [(p, j) for j, p in enumerate(layout.parents) if p >= 0]
    names = layout.joint_names
    if not {"spine", "spine1", "neck", "pelvis"} & set(names):
        pairs += [(names.index(a), names.index(b)) for a, b in _LINES if {a, b} <= set(names)]
    return tuple(pairs)


def _trajectory(
    person_id: int, stages: Stages, placement: WorldAlignment, rows: IntArray
) -> PersonTrajectory:
    o = stages.rounds[-1].observations
    joints = placement.to_result(_path(stages.rounds[-1], rows))
    times = o.start_s + o.step_s * (o.knot[rows[0]] + np.arange(len(joints)))
    return PersonTrajectory(person_id, stages.skeleton.layout, times, joints)
