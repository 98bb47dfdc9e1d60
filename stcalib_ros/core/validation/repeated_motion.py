"""Whether a camera fits as well at another time offset and, at the same time, another place.

Where somebody repeats a motion a step further on, a camera whose time offset is wrong by that
repetition fits if it is moved by the same step: no offset that is tried at its own place shows it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.geometry.alignment import umeyama
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.relative_pose import relative_pose
from stcalib_ros.core.registration.two_view_refinement import refine_pair
from stcalib_ros.core.validation.cross_view import matches_of
from stcalib_ros.core.validation.offset_ambiguity import within_range
from stcalib_ros.core.validation.thresholds import (
    MAX_MOVED_DISTANCE,
    MAX_REPETITION_DISTANCE,
    MIN_OFFSET_DIFFERENCE_FRAMES,
    MIN_REPETITION_OVERLAP,
    PERIOD_RANGE_S,
)

_MAX_ROWS = 200
"""Images of a camera that are compared, count; purely numerical: neighbouring ones are alike."""
_MAX_SEARCHED = 60
"""Of these, images in which repetitions are looked for, count; cost alone."""
_JOINTS = 6
"""Joints of a person that are compared, about; purely numerical: neighbours move together."""
_MAX_CANDIDATES = 2
"""Repetitions of a motion that are tried, count; cost alone: a period earlier and later."""


class _Images(NamedTuple):
    """Some images of one camera: rows of the observations, and those of the same people by time."""

    camera: int
    rows: IntArray  # (N,)
    later: IntArray  # (S, N), rows at other times; -1 where there is none
    shifts: IntArray  # (S,), time bins


def repetition_ratios(
    cameras: Sequence[LiftedCamera],
    last: Iteration,
    *,
    max_shift: int,
    offset_range_s: float = np.inf,
) -> tuple[Float64Array, Float64Array]:
    """Compare the error of each camera with that at a repetition of the motion, moved with it.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    last : Iteration
    max_shift : int
        Largest difference of an alternative from the time offset found, time bins.
    offset_range_s : float
        Offsets of cameras beyond plus and minus this are no alternatives.

    Returns
    -------
    ratio : (C,) ndarray
        Median epipolar error at the best repetition over that at the offset found, both after
        refinement of the pose, the median over the other cameras;
        infinite where no motion repeats itself with a usual period.
    distance_s : (C,) ndarray
        How far from the offset found that repetition is, s; zero without one.
    """
    C = len(last.rig.cameras)
    ratio, distance_s = np.full(C, np.inf), np.zeros(C)
    X = np.where(last.state.triangulated()[..., None], last.state.X, np.nan)
    for images in _images(last, max_shift):
        possible = within_range(last, -images.shifts, offset_range_s)[images.camera]
        for s in _repetitions(X, images, possible):
            found = _error_ratio(cameras, last, X, images, s)
            if found < ratio[images.camera]:
                ratio[images.camera] = found
                distance_s[images.camera] = abs(images.shifts[s]) * last.observations.step_s
    return ratio, distance_s


def _images(last: Iteration, max_shift: int) -> list[_Images]:
    """Images of every camera, with the rows of the same persons at all other offsets."""
    obs = last.observations
    shortest, longest = (round(period_s / obs.step_s) for period_s in PERIOD_RANGE_S)
    max_shift = min(max_shift, longest)
    far = np.arange(max(shortest, MIN_OFFSET_DIFFERENCE_FRAMES), max_shift + 1)
    shifts = np.concatenate([-far[::-1], far])
    found = []
    for c in range(len(last.rig.cameras)):
        rows = np.flatnonzero(obs.track[:, c] >= 0)
        rows = rows[:: 1 + (len(rows) - 1) // _MAX_ROWS]
        bins = obs.time_bin[rows] + shifts[:, None]
        found.append(_Images(c, rows, obs.rows_of(obs.person[rows], bins), shifts))
    return found


def _repetitions(X: Float64Array, images: _Images, possible: BoolArray) -> list[int]:
    """Shifts (numbers) at which one rigid motion takes people to where they were, best first."""
    some = X[:, :: max(1, X.shape[1] // _JOINTS)]
    thin = slice(None, None, 1 + (len(images.rows) - 1) // _MAX_SEARCHED)
    here, later = some[images.rows[thin]], images.later[:, thin]
    there = np.where((later >= 0)[..., None, None], some[later], np.nan)
    distance, common = _rigid_distances(here.reshape(-1, 3), there.reshape(len(later), -1, 3))
    least = MIN_REPETITION_OVERLAP * np.isfinite(here).all(-1).sum()
    distance = np.where(common >= max(least, 1), distance, np.inf)
    padded = np.concatenate([[np.inf], distance, [np.inf]])
    minima = distance <= np.minimum(padded[:-2], padded[2:])
    close = np.flatnonzero(possible & minima & (distance < MAX_REPETITION_DISTANCE))
    return [int(s) for s in close[np.argsort(distance[close])][:_MAX_CANDIDATES]]


def _rigid_distances(a: Float64Array, b: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Root mean square distances (S,) of points (M, 3) to others (S, M, 3) after the best motions.

    And the numbers of points that are finite in both.
    """
    both = np.asarray(np.isfinite(a + b).all(-1))[..., None]
    n = both.sum((1, 2))
    p, q = (_centred(one, both) for one in (a[None], b))
    covariance = np.einsum("smi,smj->sij", p, q, optimize=True)
    singular = np.linalg.svd(covariance, compute_uv=False)
    singular[:, 2] *= np.where(np.linalg.det(covariance) < 0.0, -1.0, 1.0)
    squared = (p**2).sum((1, 2)) + (q**2).sum((1, 2)) - 2.0 * singular.sum(1)
    return np.sqrt(np.maximum(squared, 0.0) / np.maximum(n, 1)), n.astype(np.float64)


def _centred(points: Float64Array, counted: BoolArray) -> Float64Array:
    """Points (S, M, 3) less the means of those that count (S, M, 1); zero where they do not."""
    known = np.where(counted, points, 0.0)
    mean = known.sum(1, keepdims=True) / np.maximum(counted.sum(1, keepdims=True), 1)
    return np.where(counted, known - mean, 0.0)


def _error_ratio(
    cameras: Sequence[LiftedCamera], last: Iteration, X: Float64Array, images: _Images, s: int
) -> float:
    """Error of a camera at a repetition, moved with the people, over its error at its own place.

    The median over the other cameras: where one of these is wrong, it fits better elsewhere, too.
    Infinite where people repeat themselves at the same place: there the camera need not move.
    """
    known = np.flatnonzero(images.later[s] >= 0)
    here, there = X[images.rows[known]], X[images.later[s][known]]
    both = np.isfinite(here + there).all(-1)
    here, there = here[both], there[both]
    R, t = _rigid_motion(there, here)
    in_place, moved = there - here, there @ R.T + t - here
    if np.linalg.norm(moved) > MAX_MOVED_DISTANCE * np.linalg.norm(in_place):
        return np.inf
    state, c = last.state, images.camera
    R_c, t_c = state.R_cam_ref[c] @ R, state.R_cam_ref[c] @ t + state.t_cam_ref[c]
    ratios = []
    for o in range(len(state.t_cam_ref)):
        matches = matches_of(last, c, o)
        if o == c or not matches:
            continue
        own = relative_pose(last.rig, c, o, matches)
        R_c_o = R_c @ state.R_cam_ref[o].T
        rival = replace(
            own,
            R_a_b=R_c_o,
            t_a_b=t_c - R_c_o @ state.t_cam_ref[o],
            lag_s=own.lag_s + float(images.shifts[s]) * last.observations.step_s,
        )
        at_own, elsewhere = refine_pair(cameras, own), refine_pair(cameras, rival)
        if at_own is not None and elsewhere is not None:
            ratios.append(elsewhere.epipolar_px / max(at_own.epipolar_px, 1e-12))
    return float(np.median(ratios)) if ratios else np.inf


def _rigid_motion(a: Float64Array, b: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Rotation and translation that take points (M, 3) to others."""
    _, R, _ = umeyama(a, b)
    return R, b.mean(0) - a.mean(0) @ R.T
