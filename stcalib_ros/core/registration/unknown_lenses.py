"""From what pairs of cameras agree on to the lenses of those that are not known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stcalib_ros.core.lifting.upright_people import focal_length_prior
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.options import LensOptions
from stcalib_ros.core.registration.correspondences import Correspondences, correspondences
from stcalib_ros.core.registration.epipolar_search import Agreement
from stcalib_ros.core.registration.fov_lens import (
    EQUIDISTANT,
    LOG_FOCAL,
    RADIAL,
    fitted_lens,
    scaled_lens,
)
from stcalib_ros.core.registration.lens_search import LensUnknowns, search_lenses
from stcalib_ros.core.registration.limits import (
    FOCAL_START,
    FOCAL_STDDEV,
    LENS_KEYPOINTS,
    MIN_POINTS,
    MOST_BENT,
    RADIAL_STDDEV,
    SURELY_BENT,
)
from stcalib_ros.core.registration.pairs import PairTask
from stcalib_ros.core.registration.two_view_lenses import PairPoints

_MAX_POINTS = 4000
"""Keypoints of all pairs by which lenses are searched for, about. Numerical: bounds the cost."""
_POINTS_OF_PAIR = (120, 400)
"""Keypoints of a pair, least and most, about. Numerical: twice `MIN_POINTS`; more are hardly
independent."""
_OUTERMOST = 98.0
"""Percentile of the radii of keypoints up to which a lens is fitted. Numerical: without strays."""


def find_lenses(
    lifted: Sequence[LiftedCamera],
    skeleton: Skeleton,
    tasks: Sequence[PairTask],
    found: Sequence[Sequence[Agreement]],
    options: LensOptions,
) -> dict[int, Intrinsics]:
    """Find the lenses of the cameras whose own are unknown or to be refined.

    Parameters
    ----------
    lifted : sequence of LiftedCamera
        All cameras, lifted by the lenses to start from.
    skeleton : Skeleton
    tasks : sequence of PairTask
        Pairs of cameras.
    found : sequence of sequence of Agreement
        What each of them agrees on, the best supported first.
    options : LensOptions

    Returns
    -------
    dict of int to Intrinsics
        By the index of the camera; empty where no pair has enough common keypoints.
    """
    points = _pair_points(tasks, found)
    if points is None:
        return {}
    unknowns = _unknowns(lifted, skeleton, np.union1d(points.a, points.b), options)
    if not len(unknowns.mean):
        return {}
    lenses = _by_families(points, unknowns)
    return {
        c: _lens(lifted[c], lenses[c], _outermost(points, c), options)
        for c in np.flatnonzero(unknowns.column[:, LOG_FOCAL] >= 0).tolist()
    }


def _by_families(points: PairPoints, unknowns: LensUnknowns) -> Float64Array:
    """Return lenses (C, 2) that are equidistant where they are nearly so.

    A radial coefficient that is free goes with the focal length to some part.
    """
    found = search_lenses(points, unknowns)
    lenses, radial = found.views.lenses, found.views.lenses[:, RADIAL]
    bent = (radial < MOST_BENT) & (radial < -SURELY_BENT * found.stddev[:, RADIAL])
    fisheye = (unknowns.column[:, RADIAL] >= 0) & bent
    if not fisheye.any():
        return lenses
    column, known = unknowns.column.copy(), unknowns.known.copy()
    column[fisheye, RADIAL], known[fisheye, RADIAL] = -1, EQUIDISTANT
    start = unknowns.values(lenses)
    again = replace(unknowns, column=column, known=known, start=start)
    return search_lenses(points, again).views.lenses


def _lens(
    camera: LiftedCamera, lens: Float64Array, radius: float, options: LensOptions
) -> Intrinsics:
    """Return what was found of a camera in the form of its recording."""
    start = _started_from(camera)
    if camera.lens_knowledge is LensKnowledge.REFINE:
        return scaled_lens(start, lens)
    return fitted_lens(start, lens, radius=radius, radial_terms=options.radial_terms)


def _started_from(camera: LiftedCamera) -> Intrinsics:
    if camera.intrinsics is None:
        raise AssertionError(f"camera {camera.name!r} was lifted without a lens")
    return camera.intrinsics


def _outermost(points: PairPoints, camera: int) -> float:
    """Radius about the principal point, on the plane z = 1, within which its keypoints are."""
    own = [points.m_a[k][points.observed[k]] for k in np.flatnonzero(points.a == camera)]
    own += [points.m_b[k][points.observed[k]] for k in np.flatnonzero(points.b == camera)]
    return float(np.percentile(np.linalg.norm(np.concatenate(own), axis=-1), _OUTERMOST))


def _unknowns(
    lifted: Sequence[LiftedCamera], skeleton: Skeleton, cameras: IntArray, options: LensOptions
) -> LensUnknowns:
    """Return the unknowns of the lenses of some cameras, one for all of a group."""
    column = np.full((len(lifted), 2), -1)
    numbers: dict[tuple[str, LensKnowledge, int], int] = {}
    start: list[float] = []
    # Of the priors of each unknown, the precision, and the mean times the precision.
    precision, moment = [], []
    # Rotations around three cameras and more tell focal lengths ten times as well as people do.
    by_people = len(cameras) <= 2
    for c in cameras.tolist():
        camera = lifted[c]
        for kind, first, stddev in _coefficients(camera, options):
            key = (camera.lens_group or f"{c}", camera.lens_knowledge, kind)
            column[c, kind] = numbers.setdefault(key, len(numbers))
            if column[c, kind] == len(start):
                start.append(first)
                precision.append(stddev**-2)
                moment.append(0.0)
            asked = by_people and kind == LOG_FOCAL
            upright = focal_length_prior(camera, skeleton) if asked else None
            if upright is not None:
                precision[column[c, kind]] += upright.stddev**-2
                moment[column[c, kind]] += upright.log_ratio * upright.stddev**-2
    H = np.array(precision)
    return LensUnknowns(
        column, np.zeros((len(lifted), 2)), np.array(start), np.array(moment) / H, H**-0.5
    )


def _coefficients(
    camera: LiftedCamera, options: LensOptions
) -> tuple[tuple[int, float, float], ...]:
    """Return the coefficients of a lens that are unknown, where each starts, and its deviation.

    A fisheye that is given stays as it is until the adjustment: another focal length is no factor
    of its bearings.
    """
    if camera.lens_knowledge is LensKnowledge.UNKNOWN:
        focal = (LOG_FOCAL, FOCAL_START, FOCAL_STDDEV)
        return (focal, (RADIAL, 0.0, RADIAL_STDDEV)) if options.radial_terms else (focal,)
    given = camera.lens_knowledge is LensKnowledge.GIVEN
    if given or _started_from(camera).model is LensModel.EQUIDISTANT:
        return ()
    return ((LOG_FOCAL, 0.0, options.focal_stddev),)


def _pair_points(
    tasks: Sequence[PairTask], found: Sequence[Sequence[Agreement]]
) -> PairPoints | None:
    """Return the keypoints of the best agreement of each pair; None where there are too few."""
    most = int(np.clip(_MAX_POINTS // max(1, len(tasks)), *_POINTS_OF_PAIR))
    pairs = [(t, f[0], _common(t, f[0], most)) for t, f in zip(tasks, found, strict=True) if f]
    pairs = [pair for pair in pairs if len(pair[2].x_a) >= MIN_POINTS]
    if not pairs:
        return None
    n = max(len(c.x_a) for _, _, c in pairs)
    return PairPoints(
        np.array([task.a for task, _, _ in pairs]),
        np.array([task.b for task, _, _ in pairs]),
        np.stack([_padded(c.x_a, n) for _, _, c in pairs]),
        np.stack([_padded(c.x_b, n) for _, _, c in pairs]),
        np.stack([_padded(c.v_b, n) for _, _, c in pairs]),
        np.stack([np.arange(n) < len(c.x_a) for _, _, c in pairs]),
        np.array([task.moments[0].focal_px for task, _, _ in pairs]),
        np.array([task.moments[1].focal_px for task, _, _ in pairs]),
        np.array([one.points / LENS_KEYPOINTS for _, one, _ in pairs]),
    )


def _common(task: PairTask, one: Agreement, max_points: int) -> Correspondences:
    a, b = (pieces.camera for pieces in task.pieces)
    h = RelativePose(0, 1, np.eye(3), np.zeros(3), one.lag * task.step_s, one.matches, one.points)
    return correspondences((a, b), h, max_points=max_points)


def _padded(points: Float64Array, n: int) -> Float64Array:
    """Return the first two coordinates (n, 2) of homogeneous points, which go on with the last."""
    return np.pad(points[:, :2].astype(np.float64), ((0, n - len(points)), (0, 0)), mode="edge")
