"""How clearly the images tell a camera's clock offset from all others."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.residuals import at_images
from stcalib_ros.core.bundle.state import person_rows_of
from stcalib_ros.core.geometry.so3 import hat
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.relative_pose import relative_pose

_FAR_FRAMES = 3
_CONTRAST_SCALE = 2.0
_CONTRAST_JOINTS = 5
_MIN_CONTRAST_POINTS = 60


def offset_peak_ratios(
    last: Iteration, *, max_shift: int, with_outliers: bool = False
) -> tuple[Float64Array, Float64Array]:
    """Error (C,) of each camera's best other offset over its error at the offset found.

    And how far away (C,) that one is, seconds. Of the points that fit, or of all of the persons
    `with_outliers`: those that do not fit here may do so there.

    The error is the epipolar distance to the points of the other cameras, shifted by whole
    knots: it owes nothing to the triangulated points. Where nobody moves, all shifts fit
    alike and the contrast is one; where too few points are common it is zero.
    """
    C = len(last.rig.cameras)
    far = [*range(_FAR_FRAMES, 3 * _FAR_FRAMES), *range(3 * _FAR_FRAMES, max_shift + 1, 3)]
    shifts = np.array([*(-d for d in reversed(far)), 0, *far])
    scale = _CONTRAST_SCALE * max(last.association.typical_px, 1.0)
    total, count = np.zeros((C, len(shifts))), np.zeros((C, len(shifts)))
    taken = last.observations.seen if with_outliers else last.state.used
    for path in _image_paths(last, taken):
        for a in range(C):
            for b in range(a + 1, C):
                h = relative_pose(last.rig, a, b)
                E = hat(h.t_a_b / np.linalg.norm(h.t_a_b)) @ h.R_a_b
                cost, n = _shifted_costs(E, path[a], path[b], shifts, scale)
                for c, order in ((a, slice(None, None, -1)), (b, slice(None))):
                    total[c] += cost[order]
                    count[c] += n[order]
    known = count >= _MIN_CONTRAST_POINTS
    mean = np.where(known, total / np.maximum(count, 1), np.inf)
    found = np.flatnonzero(shifts == 0)[0]
    others = np.where(shifts != 0, mean, np.inf)
    here = np.where(known[:, found], np.maximum(mean[:, found], 1e-12), np.inf)
    away_s = np.abs(shifts[others.argmin(1)]) * last.observations.step_s
    return np.where(known[:, found], others.min(1), 0.0) / here, away_s


def _shifted_costs(
    E: Float64Array, a: Float64Array, b: Float64Array, shifts: IntArray, scale: float
) -> tuple[Float64Array, Float64Array]:
    """Robust epipolar cost of knots k of a with knots k + shift of b, and how many there are."""
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


def _image_paths(last: Iteration, taken: BoolArray) -> Iterator[Float64Array]:
    """Points (C, K, J, 4) of one person after the other: x, y, 1 on the plane z = 1 and focal.

    Brought to the time of their knots by the motion model; a few joints; NaN where not taken
    (N, C, J).
    """
    o, state = last.observations, last.state
    joints = slice(None, None, max(1, o.x.shape[2] // _CONTRAST_JOINTS))
    R = np.swapaxes(state.R_cam_ref, -1, -2)
    for rows in person_rows_of(o):
        X = (state.X[rows][:, None, joints], at_images(o, state, rows)[:, :, joints])
        at_knot, at_image = (one @ R + state.t_cam_ref[:, None] for one in X)
        with np.errstate(divide="ignore", invalid="ignore"):
            motion = at_image[..., :2] / at_image[..., 2:] - at_knot[..., :2] / at_knot[..., 2:]
        points = np.concatenate(
            [
                o.x[rows, :, joints] - motion,
                np.ones_like(motion[..., :1]),
                o.focal[rows, :, joints, None],
            ],
            -1,
        )
        points[~taken[rows, :, joints]] = np.nan
        knots = o.knot[rows] - o.knot[rows][0]
        path = np.full((points.shape[1], int(knots[-1]) + 1, *points.shape[2:]), np.nan)
        path[:, knots] = np.moveaxis(points, 1, 0)
        yield path
