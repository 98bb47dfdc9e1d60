"""Pairs of cameras as independent tasks, for whatever executor there is.

A task is picklable and holds what its two cameras saw, not the recording: process pools and
clusters carry it elsewhere, and the answers are the same wherever they were found.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.options import Options, RegistrationOptions
from stcalib_ros.core.registration.correspondences import MAX_POINTS, correspondences
from stcalib_ros.core.registration.epipolar_correlation import KeypointMoments, keypoint_moments
from stcalib_ros.core.registration.epipolar_search import (
    Agreement,
    by_other_lenses,
    search,
)
from stcalib_ros.core.registration.essential import pose_by_cheirality, robust_essential
from stcalib_ros.core.registration.limits import (
    MIN_POINTS,
    MIN_SUPPORT_RATIO,
    SAME_LAG,
    SAME_ROTATION,
)
from stcalib_ros.core.registration.pieces import Pieces, cut_tracks, longest
from stcalib_ros.core.registration.pose_prior import pose_prior
from stcalib_ros.core.registration.resampling import Grid
from stcalib_ros.core.registration.two_view_refinement import refine_pair


@dataclass(frozen=True, slots=True, eq=False)
class PairTask:
    """Two cameras to be registered.

    Attributes
    ----------
    a, b : int
        Indices of the cameras, as the hypotheses carry them.
    pieces : (Pieces, Pieces)
        Their tracks.
    moments : (KeypointMoments, KeypointMoments)
        Of the pieces, on one grid.
    step_s : float
        Step of the grid, seconds.
    max_lag : int
        Lags are searched within plus and minus this many samples.
    options : RegistrationOptions
    synchronised : bool
        The clocks are known to agree.
    max_points : int
        Keypoints of a hypothesis by which it is refined, about.
    found : tuple of Agreement or None
        What agrees on an essential matrix, the best supported first; None: it is searched for.
    """

    a: int
    b: int
    pieces: tuple[Pieces, Pieces]
    moments: tuple[KeypointMoments, KeypointMoments]
    step_s: float
    max_lag: int
    options: RegistrationOptions
    synchronised: bool
    max_points: int = MAX_POINTS
    found: tuple[Agreement, ...] | None = None


def pair_tasks(
    lifted: Sequence[LiftedCamera],
    cameras: Sequence[int],
    skeleton: Skeleton,
    options: Options,
    *,
    grid: Grid,
) -> list[PairTask]:
    """Return the tasks of all pairs of some cameras, sampled on a grid."""
    pieces = {c: longest(cut_tracks(lifted[c], skeleton.layout)) for c in cameras}
    moments = {c: keypoint_moments(pieces[c].camera, grid) for c in cameras}
    max_lag = int(np.ceil(2.0 * options.offset_range_s / grid.step_s))
    return [
        PairTask(
            a,
            b,
            (pieces[a], pieces[b]),
            (moments[a], moments[b]),
            grid.step_s,
            max_lag,
            options.registration,
            options.synchronised,
        )
        for i, a in enumerate(cameras)
        for b in cameras[i + 1 :]
    ]


def agreements(task: PairTask) -> tuple[Agreement, ...]:
    """Return what agrees on an essential matrix, the best supported first."""
    if task.found is not None:
        return task.found
    return search(*task.moments, max_lag=task.max_lag, step_s=task.step_s, options=task.options)


def with_agreements(task: PairTask, before: PairTask, found: tuple[Agreement, ...]) -> PairTask:
    """Return a task that goes on with what was found by other lenses, if its pieces are the same.

    Parameters
    ----------
    task : PairTask
    before : PairTask
        The same pair by the other lenses.
    found : tuple of Agreement
        What agreed in it.
    """
    both = zip(before.pieces, task.pieces, strict=True)
    if not all(_same_frames(one.camera, other.camera) for one, other in both):
        return task
    return replace(task, found=tuple(by_other_lenses(one, *task.moments) for one in found))


def _same_frames(one: LiftedCamera, other: LiftedCamera) -> bool:
    return len(one.tracks) == len(other.tracks) and all(
        np.array_equal(a.frames, b.frames) for a, b in zip(one.tracks, other.tracks, strict=True)
    )


def register(task: PairTask) -> tuple[RelativePose, ...]:
    """Return the hypotheses on a pair of cameras, refined, the best supported first."""
    cameras = tuple(pieces.camera for pieces in task.pieces)
    refined = (_refined(h, task, cameras) for h in _starts(task, cameras))
    found = (h for h in refined if h is not None and h.support > 0.0)
    best = sorted(found, key=lambda h: -h.support)
    kept = _distinct(best, task.step_s)[: task.options.n_hypotheses]
    return tuple(_of_tracks(h, task) for h in kept)


def _refined(
    h: RelativePose, task: PairTask, cameras: tuple[LiftedCamera, ...]
) -> RelativePose | None:
    """Refine a hypothesis on its keypoints, with what 3D poses say where there are any."""
    return refine_pair(
        cameras,
        h,
        synchronised=task.synchronised,
        prior=pose_prior(cameras, h),
        max_points=task.max_points,
    )


def _starts(task: PairTask, cameras: tuple[LiftedCamera, ...]) -> Iterator[RelativePose]:
    """Yield the relative poses of what agrees on an essential matrix."""
    found = agreements(task)
    for one in found:
        if one.support >= MIN_SUPPORT_RATIO * found[0].support:
            start = _start(cameras, one, task.step_s)
            if start is not None:
                yield start


def _start(
    cameras: tuple[LiftedCamera, ...], found: Agreement, step_s: float
) -> RelativePose | None:
    """Return the relative pose of an agreement of pieces; None with too few common keypoints."""
    h = RelativePose(0, 1, np.eye(3), np.zeros(3), found.lag * step_s, found.matches, found.points)
    common = correspondences(cameras, h)
    if len(common.x_a) < MIN_POINTS:
        return None
    R_a_b, t_a_b = pose_by_cheirality(robust_essential(found.E, common), common)
    return replace(h, R_a_b=R_a_b, t_a_b=t_a_b, epipolar_px=found.error_px)


def _distinct(hypotheses: Sequence[RelativePose], step_s: float) -> list[RelativePose]:
    """Drop hypotheses that came to the same as a better one."""
    kept: list[RelativePose] = []
    for h in hypotheses:
        if not any(
            abs(h.lag_s - other.lag_s) < SAME_LAG * step_s
            and float(rotation_angle(h.R_a_b.T @ other.R_a_b)) < SAME_ROTATION
            for other in kept
        ):
            kept.append(h)
    return kept


def _of_tracks(h: RelativePose, task: PairTask) -> RelativePose:
    """Return a hypothesis on pieces as one on the tracks of the recording."""
    a, b = task.pieces
    matches = {
        (one.track, other.track)
        for p, q in h.matches
        for one in a.parts[p]
        for other in b.parts[q]
        if one.begin_s + h.lag_s <= other.end_s and other.begin_s <= one.end_s + h.lag_s
    }
    return replace(h, a=task.a, b=task.b, matches=tuple(sorted(matches)))
