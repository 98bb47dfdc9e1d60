"""Whether another time offset of a camera fits about as well as the one that was found."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.residuals import at_images
from stcalib_ros.core.bundle.state import person_rows_of
from stcalib_ros.core.geometry.so3 import hat
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.relative_pose import relative_pose
from stcalib_ros.core.validation.thresholds import (
    MIN_OFFSET_DIFFERENCE_FRAMES,
    MIN_OFFSET_POINTS,
    OFFSET_ERROR_SCALE,
)

_JOINTS = 5
"""Joints of a person that are compared, about; purely numerical: neighbours move together."""
_FINE_FRAMES = 9
"""Frames. From here on every third alternative is tried; purely numerical: errors vary slowly."""
_CURVE_POINTS = 40
"""Count. Offsets to either side of a curve; purely numerical: a picture is not wider than that."""


@dataclass(frozen=True, slots=True, eq=False)
class OffsetCurves:
    """How well other time offsets of each camera fit than the one that was found.

    Attributes
    ----------
    difference_s : (S,) ndarray
        Difference from the offset found, increasing; 0 in the middle.
    error : (C, S) ndarray
        Mean error of the camera at each, over that at the offset found; NaN where too few
        observations are common.
    """

    difference_s: Float64Array
    error: Float64Array

    def runner_up(self, c: int) -> int:
        """Return which offset of camera c fits best of all other minima of its curve, or -1."""
        error = np.where(np.isfinite(self.error[c]), self.error[c], np.inf)
        inner = error[1:-1]
        lowest = (inner <= error[:-2]) & (inner <= error[2:]) & np.isfinite(inner)
        others = np.flatnonzero(lowest & (self.difference_s[1:-1] != 0.0)) + 1
        return int(others[error[others].argmin()]) if len(others) else -1


def offset_curves(last: Iteration, *, range_s: float) -> OffsetCurves:
    """Return the errors of all cameras at offsets within plus and minus `range_s`.

    Parameters
    ----------
    last : Iteration
    range_s : float
        Seconds.
    """
    step_s = last.observations.step_s
    furthest = max(1, round(range_s / step_s))
    near = np.rint(furthest * np.linspace(0.0, 1.0, _CURVE_POINTS + 1) ** 2).astype(np.int64)
    near = np.unique(near[near > 0])
    shifts = np.concatenate([-near[::-1], [0], near])
    scale = OFFSET_ERROR_SCALE * max(last.association.typical_px, 1.0)
    total, count = _costs_by_camera(last, shifts, scale, with_outliers=False)
    mean = np.where(count >= MIN_OFFSET_POINTS, total / np.maximum(count, 1), np.nan)
    error = mean / np.maximum(mean[:, [len(near)]], 1e-12)
    return OffsetCurves(-shifts[::-1] * step_s, error[:, ::-1])


def offset_peak_ratios(
    last: Iteration,
    *,
    max_shift: int,
    offset_range_s: float = np.inf,
    with_outliers: bool = False,
) -> tuple[Float64Array, Float64Array]:
    """Compare the error at each camera's offset with that at the best other offset.

    The error is the epipolar distance to the observations of the other cameras, shifted by whole
    time bins; it does not depend on the triangulated points. Where nobody moves, all offsets fit
    equally well and the ratio is one.

    Parameters
    ----------
    last : Iteration
    max_shift : int
        Largest difference of an alternative from the offset found, time bins.
    offset_range_s : float
        Offsets of cameras beyond plus and minus this are no alternatives.
    with_outliers : bool
        Use all observations of associated persons, not inliers alone: outliers at the offset found
        may fit at another one.

    Returns
    -------
    ratio : (C,) ndarray
        Smallest mean error of all alternatives over the mean error at the offset found. Zero where
        too few observations are common, infinite where the range has no alternatives.
    distance_s : (C,) ndarray
        How far from the offset found the best alternative is, s; zero without alternatives.
    """
    shifts = _shifts(max_shift)
    scale = OFFSET_ERROR_SCALE * max(last.association.typical_px, 1.0)
    total, count = _costs_by_camera(last, shifts, scale, with_outliers=with_outliers)
    known = count >= MIN_OFFSET_POINTS
    mean = np.where(known, total / np.maximum(count, 1), np.inf)
    found = len(shifts) // 2
    possible = within_range(last, shifts, offset_range_s)
    others = np.where(possible & (shifts != 0), mean, np.inf)
    best = others.min(1)
    here = np.where(known[:, found], np.maximum(mean[:, found], 1e-12), np.inf)
    distance_s = np.abs(shifts[others.argmin(1)]) * last.observations.step_s
    return np.where(known[:, found], best, 0.0) / here, distance_s


def within_range(last: Iteration, shifts: IntArray, offset_range_s: float) -> BoolArray:
    """Return which shifts of the images of each camera (C, S) keep its offset within a range.

    An image that is compared with others of time bins before its own has a smaller offset. A bin
    of tolerance, as offsets are found to fractions of it.
    """
    step_s = last.observations.step_s
    offset_s = last.rig.offset_s[:, None] - shifts * step_s
    return np.asarray(np.abs(offset_s) <= offset_range_s + step_s)


def _shifts(max_shift: int) -> IntArray:
    """Alternatives within plus and minus `max_shift` time bins, and 0 in their middle."""
    far = [
        *range(MIN_OFFSET_DIFFERENCE_FRAMES, min(_FINE_FRAMES, max_shift + 1)),
        *range(_FINE_FRAMES, max_shift + 1, 3),
    ]
    return np.array([*(-d for d in reversed(far)), 0, *far])


def _costs_by_camera(
    last: Iteration, shifts: IntArray, scale: float, *, with_outliers: bool
) -> tuple[Float64Array, Float64Array]:
    """Sums of robust costs (C, S) of each camera at each shift, and their counts (C, S)."""
    C = len(last.rig.cameras)
    total, count = np.zeros((C, len(shifts))), np.zeros((C, len(shifts)))
    taken = last.observations.observed if with_outliers else last.state.inlier
    for path in _paths_at_bins(last, taken):
        for a in range(C):
            for b in range(a + 1, C):
                pose = relative_pose(last.rig, a, b)
                E = hat(pose.t_a_b / np.linalg.norm(pose.t_a_b)) @ pose.R_a_b
                cost, n = _shifted_costs(E, path[a], path[b], shifts, scale)
                for c, order in ((a, slice(None, None, -1)), (b, slice(None))):
                    total[c] += cost[order]
                    count[c] += n[order]
    return total, count


def _shifted_costs(
    E: Float64Array, a: Float64Array, b: Float64Array, shifts: IntArray, scale: float
) -> tuple[Float64Array, Float64Array]:
    """Robust epipolar cost (S,) of bins k of a with bins k + shift of b, and counts (S,)."""
    n = len(a)
    cost, count = np.zeros(len(shifts)), np.zeros(len(shifts))
    line_a, line_b = b[..., :3] @ E.T, a[..., :3] @ E
    steep_a, steep_b = ((line[..., :2] ** 2).sum(-1) for line in (line_a, line_b))
    focal_a, focal_b = a[..., 3] / scale, b[..., 3] / scale
    for k, d in enumerate(shifts):
        if n - abs(d) > 0:
            here, there = slice(max(0, -d), n - max(0, d)), slice(max(0, d), n - max(0, -d))
            distance = np.einsum("kji,kji->kj", a[here, :, :3], line_a[there])
            steepness = np.maximum(steep_b[here] + steep_a[there], 1e-18)
            squared = distance**2 / steepness * focal_a[here] * focal_b[there]
            good = squared[np.isfinite(squared)]
            cost[k], count[k] = np.log1p(good).sum(), len(good)
    return cost, count


def _paths_at_bins(last: Iteration, taken: BoolArray) -> Iterator[Float64Array]:
    """Observations (C, K, J, 4) of one person after the other: x, y, 1 at z = 1, and focal length.

    The motion model brings them from the times of their images to those of their bins. A few
    joints; NaN where not taken (N, C, J).
    """
    obs, state = last.observations, last.state
    joints = slice(None, None, max(1, obs.x.shape[2] // _JOINTS))
    R_ref_cam = np.swapaxes(state.R_cam_ref, -1, -2)
    for rows in person_rows_of(obs):
        X = (state.X[rows][:, None, joints], at_images(obs, state, rows)[:, :, joints])
        at_bin, at_image = (one @ R_ref_cam + state.t_cam_ref[:, None] for one in X)
        with np.errstate(divide="ignore", invalid="ignore"):
            motion = at_image[..., :2] / at_image[..., 2:] - at_bin[..., :2] / at_bin[..., 2:]
        points = np.concatenate(
            [
                obs.x[rows, :, joints] - motion,
                np.ones_like(motion[..., :1]),
                obs.focal[rows, :, joints, None],
            ],
            -1,
        )
        points[~taken[rows, :, joints]] = np.nan
        bins = obs.time_bin[rows] - obs.time_bin[rows][0]
        path = np.full((points.shape[1], int(bins[-1]) + 1, *points.shape[2:]), np.nan)
        path[:, bins] = np.moveaxis(points, 1, 0)
        yield path
