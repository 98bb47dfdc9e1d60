"""The people of a calibration: their joints in 3D over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.motion_filter import principal_variances
from stcalib_ros.core.bundle.residuals import noise_px
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.reconstruction.people import found_persons, joint_path

_LINES = (
    ("left_shoulder", "right_shoulder"),
    ("left_hip", "right_hip"),
    ("left_shoulder", "left_hip"),
    ("right_shoulder", "right_hip"),
)
"""Lines of the trunk, for layouts without joints between hips and shoulders."""


@dataclass(frozen=True, slots=True, eq=False)
class PersonTrajectory:
    """One person's joints over time, triangulated by the calibrated cameras.

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
        an inlier.
    stddev : (K, J) ndarray
        Standard deviation of a joint's position, the root of the sum over the axes, in the same
        unit: what the noise of the keypoints makes of it, with the cameras taken as known.
    """

    person_id: int
    layout: Layout
    times_s: Float64Array
    joints_ref: Float64Array
    stddev: Float64Array


def reconstruct(
    cameras: Sequence[LiftedCamera],
    last: Iteration,
    layout: Layout,
    to_result: Callable[[Float64Array], Float64Array],
) -> tuple[PersonTrajectory, ...]:
    """Return the joints of all persons, in the order of the calibration's persons.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    last : Iteration
        Result of the bundle adjustment.
    layout : Layout
        Layout of its joints.
    to_result : callable
        Transform of points (..., 3) from the frame and unit of the adjustment to those of the
        result.
    """
    found = found_persons(cameras, last)
    obs, state = last.observations, last.state
    variances, _ = principal_variances(obs, state, noise_px(obs, state))
    origin, along_x = to_result(np.zeros(3)), to_result(np.array([1.0, 0.0, 0.0]))
    stddev = float(np.linalg.norm(along_x - origin)) * np.sqrt(variances.sum(-1))
    return tuple(
        _trajectory(person.person_id, last, rows, layout, to_result, stddev)
        for (_, person), rows in zip(found, person_rows(cameras, last), strict=True)
    )


def person_rows(cameras: Sequence[LiftedCamera], last: Iteration) -> tuple[IntArray, ...]:
    """Return the rows of the observations of each person of the calibration, in order of time."""
    obs = last.observations
    rows = [np.flatnonzero(np.isin(obs.person, own)) for own, _ in found_persons(cameras, last)]
    return tuple(own[np.argsort(obs.time_bin[own], kind="stable")] for own in rows)


def bones(layout: Layout) -> tuple[tuple[int, int], ...]:
    """Return the pairs of joints that a figure connects: every bone, and the trunk's outline."""
    pairs = [(p, j) for j, p in enumerate(layout.parents) if p >= 0]
    names = layout.joint_names
    if not {"spine", "spine1", "pelvis"} & set(names):
        pairs += [(names.index(a), names.index(b)) for a, b in _LINES if {a, b} <= set(names)]
    return tuple(pairs)


def _trajectory(
    person_id: int,
    last: Iteration,
    rows: IntArray,
    layout: Layout,
    to_result: Callable[[Float64Array], Float64Array],
    stddev: Float64Array,
) -> PersonTrajectory:
    obs = last.observations
    joints = to_result(joint_path(last, rows))
    times = obs.start_s + obs.step_s * (obs.time_bin[rows[0]] + np.arange(len(joints)))
    spread = np.full(joints.shape[:2], np.nan)
    spread[obs.time_bin[rows] - obs.time_bin[rows[0]]] = stddev[rows]
    spread[np.isnan(joints[..., 0])] = np.nan
    return PersonTrajectory(person_id, layout, times, joints, spread)
