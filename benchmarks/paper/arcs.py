"""ARCS: simultaneous rotation and correspondence search (Peng, Tsakiris and Vidal, CVPR 2022).

ARCS+ is three steps: N proposes correspondences, O removes outliers by consensus, first for the
axis of the rotation and then for its angle, both with interval stabbing, and R refines by
subgradient descent over unit quaternions. Written from the paper (arXiv 2203.14493).

Assumed here: all directions have length 1, so that N, which matches points by their norms, would
propose everything. What it is given instead is the label: a direction of one view may correspond
to the same bone in the same frame of every person of the other view. This is more than the
method asks for. The consensus threshold is that of directions with a few degrees of noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from stcalib_ros.core.model.arrays import BoolArray, Float64Array

THRESHOLD = 0.15
"""Distance of unit vectors up to which a correspondence is an inlier; chosen here."""
_AZIMUTHS = 180
"""Number of half circles that the axis is searched on."""
_DESCENT_STEPS = 60
"""Subgradient steps over the rotation."""
_FIRST_STEP = 0.2
"""Length of the first subgradient step, in the unit quaternion."""
_DECAY = 0.9
"""Ratio of one step length to the one before."""


@dataclass(frozen=True, slots=True, eq=False)
class ArcsResult:
    """Result of ARCS+.

    Attributes
    ----------
    R_a_b : (3, 3) ndarray
        Turns directions of the second view into those of the first.
    n_inliers, n_proposed : int
        Correspondences within the threshold, and in all.
    """

    R_a_b: Float64Array
    n_inliers: int
    n_proposed: int


def arcs(v_a: Float64Array, v_b: Float64Array, *, threshold: float = THRESHOLD) -> ArcsResult:
    """Rotation that most of the proposed correspondences agree with.

    Parameters
    ----------
    v_a, v_b : (M, 3) ndarray
        Unit directions; rows are proposed correspondences, most of them false.
    threshold : float
        Chord up to which two directions agree.
    """
    axis = rotation_axis(v_a - v_b, threshold)
    near_axis = np.abs((v_a - v_b) @ axis) <= threshold
    angle = rotation_about(axis, v_a[near_axis], v_b[near_axis], threshold)
    R = Rotation.from_rotvec(angle * axis).as_matrix()
    inlier = np.linalg.norm(v_a - v_b @ R.T, axis=1) <= 2.0 * threshold
    if inlier.sum() >= 2:
        R = descended(R, v_a[inlier], v_b[inlier])
    final = np.linalg.norm(v_a - v_b @ R.T, axis=1) <= threshold
    return ArcsResult(R, int(final.sum()), len(v_a))


def proposals(
    v_a: Float64Array, known_a: BoolArray, v_b: Float64Array, known_b: BoolArray
) -> tuple[Float64Array, Float64Array]:
    """All pairs of directions of one bone in one frame, regardless of the person (step N).

    Parameters
    ----------
    v_a, v_b : (P, T, S, 3), (Q, T, S, 3) ndarray
    known_a, known_b : (P, T, S), (Q, T, S) ndarray of bool

    Returns
    -------
    (M, 3), (M, 3) ndarray
    """
    both = known_a[:, None] & known_b[None]
    shape = (*both.shape, 3)
    return np.broadcast_to(v_a[:, None], shape)[both], np.broadcast_to(v_b[None], shape)[both]


def rotation_axis(difference: Float64Array, threshold: float) -> Float64Array:
    """Unit axis that most differences (M, 3) are orthogonal to, within the threshold (step O).

    For each of many azimuths the elevations that a difference allows are one interval modulo pi;
    the elevation in most intervals wins.
    """
    best, axis = -1, np.array([0.0, 0.0, 1.0])
    for phi in np.arange(_AZIMUTHS) * np.pi / _AZIMUTHS:
        across = difference[:, 0] * np.cos(phi) + difference[:, 1] * np.sin(phi)
        length = np.hypot(across, difference[:, 2])
        middle = np.arctan2(across, difference[:, 2]) + 0.5 * np.pi
        half = np.arcsin(np.minimum(threshold / np.maximum(length, 1e-12), 1.0))
        theta, count = most_stabbed(middle - half, middle + half, period=np.pi)
        if count > best:
            best = count
            axis = np.array(
                [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)]
            )
    return axis


def rotation_about(
    axis: Float64Array, v_a: Float64Array, v_b: Float64Array, threshold: float
) -> float:
    """Angle about an axis that brings most of `v_b` to `v_a` within the threshold (step O)."""
    flat_a, flat_b = (v - (v @ axis)[:, None] * axis for v in (v_a, v_b))
    angle = np.arctan2(np.cross(flat_b, flat_a) @ axis, (flat_a * flat_b).sum(1))
    reach = np.linalg.norm(flat_a, axis=1) * np.linalg.norm(flat_b, axis=1)
    square = threshold**2 - (((v_a - v_b) @ axis) ** 2)
    square = square - (np.linalg.norm(flat_a, axis=1) - np.linalg.norm(flat_b, axis=1)) ** 2
    sine = np.sqrt(np.maximum(square, 0.0) / np.maximum(4.0 * reach, 1e-12))
    half = 2.0 * np.arcsin(np.minimum(sine, 1.0))
    use = square > 0
    if not use.any():
        return 0.0
    return most_stabbed((angle - half)[use], (angle + half)[use], period=2.0 * np.pi)[0]


def most_stabbed(low: Float64Array, high: Float64Array, *, period: float) -> tuple[float, int]:
    """Point contained in most intervals of a circle, and the number of these.

    Parameters
    ----------
    low, high : (M,) ndarray
        Ends, ``high >= low``; an interval of a period or more holds everything.
    period : float
    """
    always = high - low >= period
    low, high = low[~always] % period, high[~always]
    low = np.where(low < period, low, 0.0)  # the remainder of a tiny negative number is rounded up
    high = low + (high - (high // period) * period - low) % period
    wrapped = high > period
    starts = np.concatenate([low, np.zeros(int(wrapped.sum()))])
    ends = np.concatenate([np.minimum(high, period), high[wrapped] - period])
    if not len(starts):
        return 0.0, int(always.sum())
    at = np.concatenate([starts, ends])
    change = np.concatenate([np.ones(len(starts)), -np.ones(len(ends))])
    order = np.lexsort((-change, at))
    depth = np.cumsum(change[order])
    k = int(depth.argmax())
    here = at[order]
    return float(0.5 * (here[k] + here[min(k + 1, len(here) - 1)])), int(depth[k] + always.sum())


def descended(R_a_b: Float64Array, v_a: Float64Array, v_b: Float64Array) -> Float64Array:
    """Riemannian subgradient descent of ``sum |v_a - R v_b|`` with geometric steps (step R)."""
    R = R_a_b
    step = _FIRST_STEP
    for _ in range(_DESCENT_STEPS):
        turned = v_b @ R.T
        difference = turned - v_a
        distance = np.linalg.norm(difference, axis=1)
        gradient = (np.cross(turned, difference) / np.maximum(distance, 1e-9)[:, None]).mean(0)
        length = float(np.linalg.norm(gradient))
        if length < 1e-12:
            break
        trial = Rotation.from_rotvec(-step * gradient / length).as_matrix() @ R
        if np.linalg.norm(v_a - v_b @ trial.T, axis=1).sum() < distance.sum():
            R = trial
        step *= _DECAY
    return np.asarray(R)
