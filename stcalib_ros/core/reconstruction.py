"""The people of a calibration: their joints in 3D over time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stcalib_ros.core.layouts import Layout
from stcalib_ros.core.persons import found_persons
from stcalib_ros.core.rounds import Round
from stcalib_ros.core.skeleton import Skeleton
from stcalib_ros.core.stba import persons_of
from stcalib_ros.core.timeline import GridTracks, tracks_on_grid
from stcalib_ros.core.types import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from stcalib_ros.core.pipeline import Stages
    from stcalib_ros.core.placement import Placement

_MAX_PEOPLE = 24
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
    times_s: FloatArray
    joints_ref: FloatArray


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


def joint_paths(last: Round) -> Iterator[FloatArray]:
    """Joints (K, J, 3) of every person of a round at uniform times, one person after the other.

    In the frame of the reference camera and the unit of the adjustment; NaN where fewer than two
    cameras have image points that fit.
    """
    o = last.observations
    for part in persons_of(o):
        yield _path(last, np.arange(part.start, part.stop))


def people_on_grid(
    skeleton: Skeleton, last: Round, *, start: float | None = None, n: int | None = None
) -> tuple[GridTracks, list[int]]:
    """The people, those that are seen longest, as tracks in the frame of the reference camera.

    Parameters
    ----------
    skeleton : Skeleton
    last : Round
    start : float, optional
        Time of the first sample, not after that of the first knot (the default).
    n : int, optional
        Samples, at the step of the knots; by default enough.

    Returns
    -------
    GridTracks
    list of int
        Their numbers in the observations.
    """
    o = last.observations
    start = o.start_s if start is None else start
    before = round((o.start_s - start) / o.step_s)
    n = before + int(o.knot.max()) + 1 if n is None else n
    parts = list(persons_of(o))
    longest = sorted(range(len(parts)), key=lambda k: parts[k].start - parts[k].stop)
    kept = longest[:_MAX_PEOPLE]
    paths, numbers = [], []
    for k, joints in enumerate(joint_paths(last)):
        if k in kept:
            first = before + int(o.knot[parts[k].start])
            path = np.full((n, *joints.shape[1:]), np.nan)
            path[first : first + len(joints)] = joints
            paths.append(path)
            numbers.append(int(o.person[parts[k].start]))
    return tracks_on_grid("people", paths, skeleton, start=start, step=o.step_s, n=n), numbers


def bones(layout: Layout) -> tuple[tuple[int, int], ...]:
    """Pairs of joints to draw a line between: every bone, and the trunk where it has none."""
    pairs = [(p, j) for j, p in enumerate(layout.parents) if p >= 0]
    names = layout.joint_names
    if not {"spine", "spine1", "neck", "pelvis"} & set(names):
        pairs += [(names.index(a), names.index(b)) for a, b in _LINES if {a, b} <= set(names)]
    return tuple(pairs)


def _trajectory(
    person_id: int, stages: Stages, placement: Placement, rows: IntArray
) -> PersonTrajectory:
    o = stages.rounds[-1].observations
    joints = placement.to_result(_path(stages.rounds[-1], rows))
    times = o.start_s + o.step_s * (o.knot[rows[0]] + np.arange(len(joints)))
    return PersonTrajectory(person_id, stages.skeleton.layout, times, joints)


def _path(last: Round, rows: IntArray) -> FloatArray:
    """Joints (K, J, 3) of the rows of one person, from his first knot to his last."""
    knots = last.observations.knot[rows] - last.observations.knot[rows[0]]
    known: BoolArray = last.state.used[rows].sum(1) >= 2
    joints = np.full((int(knots[-1]) + 1, *last.state.X.shape[1:]), np.nan)
    joints[knots] = np.where(known[..., None], last.state.X[rows], np.nan)
    return joints
