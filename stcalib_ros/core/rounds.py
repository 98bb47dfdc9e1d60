"""Iterated STBA (ISTBA): associate, adjust, drop what does not fit, again (Section IV)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core import stba
from stcalib_ros.core.association import SLOT_SAMPLES, Association, associate
from stcalib_ros.core.averaging import Rig
from stcalib_ros.core.geometry import rotation_angle
from stcalib_ros.core.lift import LiftedCamera
from stcalib_ros.core.observations import Observations, observe
from stcalib_ros.core.options import BundleOptions
from stcalib_ros.core.slow_motion import put_back
from stcalib_ros.core.types import BoolArray, FloatArray, IntArray

_FIRST_FLOOR_PX = 15.0
_FLOOR_PX = 8.0
_FINAL_TOLERANCE = 0.3
_TOLERANCE = 1.0
_MAX_POINTS_FIRST = 5000
_MAX_POINTS_BETWEEN = 10_000
_ENOUGH_SLOTS = 12
_MIN_SHARED_POINTS = 100
_MIN_SHARE = 0.1
_OTHER_ROTATION = 0.1
_OTHER_POSITION = 0.3
_OTHER_DISTANCE = 0.03
_OTHER_SCALE = 1.1


@dataclass(frozen=True, slots=True, eq=False)
class ClockRates:
    """Rates of the clocks of the cameras (C,) against that of the reference.

    Attributes
    ----------
    skew : (C,) ndarray
        ``t_ref = t_cam + offset + skew (t_ref - middle_s)``; 0 where not told.
    stddev : (C,) ndarray
        Predicted; of those that are not told, what it would have been.
    middle_s : float
        The moment that the offsets of the rig hold for.
    """

    skew: FloatArray
    stddev: FloatArray
    middle_s: float


@dataclass(frozen=True, slots=True, eq=False)
class StampErrors:
    """Errors of single stamps of the cameras (C,), and what they leave unknown of the clocks.

    Attributes
    ----------
    stddev_s : (C,) ndarray
        Of the error of a stamp.
    offset_variance, rate_variance : (C,) ndarray
        Of their mean and of their trend, which no image tells from offset and rate of the clock.
    """

    stddev_s: FloatArray
    offset_variance: FloatArray
    rate_variance: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class LineTimes:
    """Line times of the shutters of the cameras (C,), estimated.

    Attributes
    ----------
    line_s : (C,) ndarray
        Seconds per row; where the recording does not tell it, the given one.
    stddev_s : (C,) ndarray
        Predicted; of those that are not told, what it would have been.
    first_row_s : (C,) ndarray
        What to add to the offsets of the rig for them to hold for row 0.
    added : (7 C, 7 C) ndarray
        What not to know the line times adds to the covariance of the cameras, offsets of row 0.
    """

    line_s: FloatArray
    stddev_s: FloatArray
    first_row_s: FloatArray
    added: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Round:
    """What one round of association, adjustment and outlier removal left.

    Attributes
    ----------
    rig : Rig
        Poses and offsets after the adjustment.
    association : Association
        That the adjustment was made with.
    observations : Observations
    state : BundleState
        Of the adjustment; `state.used` are the inliers.
    median_px : float
        Reprojection error of the inliers.
    coverage : float
        How many image points stand behind each one of the observations.
    share : float
        Of all image points of a camera, matched or not, the part that fits; of the camera
        with the smallest.
    clocks : ClockRates or None
        None where they were not asked for.
    stamps : StampErrors or None
        None where stamps have no errors that images tell.
    lines : LineTimes or None
        None where they were not estimated.
    """

    rig: Rig
    association: Association
    observations: Observations
    state: stba.BundleState
    median_px: float
    coverage: float
    share: float
    clocks: ClockRates | None = None
    stamps: StampErrors | None = None
    lines: LineTimes | None = None

    def moved(self, observations: Observations, state: stba.BundleState) -> Round:
        """The same persons after one more adjustment of the same images."""
        before = replace(self.rig, offset_s=self.rig.offset_s - self.state.shift_s)
        errors = stba.errors_px(observations, state)
        median = stba.median_error(errors, state.used)
        return replace(
            self,
            rig=_rig_of(state, before),
            observations=observations,
            state=state,
            median_px=median,
        )

    def rms_px(self) -> float:
        """Root mean square reprojection error of the inliers, px; NaN if there is none."""
        errors = stba.errors_px(self.observations, self.state)[self.state.used]
        return float(np.sqrt((errors**2).mean())) if len(errors) else float("nan")

    def fit(self, scale_px: float) -> float:
        """How much of all that was seen this round explains, beyond what it was free to fit.

        A robust count of image points, less one and a half for each joint position: three
        unknowns take up as much of two coordinates. Two views always find some point that
        suits them, so that a person split in two groups of cameras explains little.
        """
        errors = stba.errors_px(self.observations, self.state)
        good = self.observations.seen & np.isfinite(errors)
        value = (1.0 / (1.0 + (errors[good] / scale_px) ** 2)).sum()
        n_points = (self.state.used.sum(1) >= 2).sum()
        return float((value - 1.5 * n_points) * self.coverage)

    def differing(self, other: Round, tolerance_s: float) -> int:
        """Cameras that stand elsewhere, or whose clock is off by more, in the other solution.

        Counted against the camera that makes the count smallest, among those that both have;
        all of them differ if the two have not two cameras in common.
        """
        common = np.intersect1d(self.rig.cameras, other.rig.cameras)
        counts = [len(common)]
        for anchor in common:
            cameras = np.array([anchor, *(c for c in common if c != anchor)])
            mine, its = (_part(one.rig, cameras) for one in (self, other))
            counts.append(int(_elsewhere(mine, its, tolerance_s).sum()))
        return min(counts) if len(common) > 1 else max(len(self.rig.cameras), 1)

    def clock_difference_s(self, other: Round) -> float:
        """Largest difference of the offsets of cameras that both have, seconds."""
        common = np.intersect1d(self.rig.cameras, other.rig.cameras)
        if not len(common):
            return float("inf")
        mine, its = (_part(one.rig, common) for one in (self, other))
        return float(np.abs(mine.offset_s - its.offset_s).max())


@dataclass(frozen=True, slots=True, eq=False)
class Unconnected:
    """Groups of cameras (positions in the rig) that share too few image points; largest first."""

    groups: tuple[tuple[int, ...], ...]


def first_round(
    cameras: Sequence[LiftedCamera], rig: Rig, o: BundleOptions, *, step_s: float
) -> Round | Unconnected:
    """Associate at the rig of the multi-view integration and adjust on a part of the joints."""
    every = _every_slot(cameras, rig, step_s)
    association = associate(cameras, rig, step_s=step_s, floor_px=_FIRST_FLOOR_PX, every=every)
    return _round(
        *(cameras, rig, association, o, step_s),
        tolerance=2.0,
        every_slot=every,
        max_points=_MAX_POINTS_FIRST,
    )


def next_round(
    cameras: Sequence[LiftedCamera], before: Round, o: BundleOptions, *, step_s: float, last: bool
) -> Round | Unconnected:
    """Associate again, adjust without the outliers; on a part of everything until the last."""
    rig = before.rig
    every = 1 if last else _every_slot(cameras, rig, step_s)
    association = associate(cameras, rig, step_s=step_s, floor_px=_FLOOR_PX, every=every)
    tolerance = _FINAL_TOLERANCE if last else _TOLERANCE
    return _round(
        *(cameras, rig, association, o, step_s),
        tolerance=tolerance,
        every_slot=every,
        max_points=None if last else _MAX_POINTS_BETWEEN,
        drop=True,
        last=last,
    )


def _every_slot(cameras: Sequence[LiftedCamera], rig: Rig, step_s: float) -> int:
    """Step between the slots that are enough to begin with: 600 samples and more."""
    longest = max(float(cameras[c].stamps[-1] - cameras[c].stamps[0]) for c in rig.cameras)
    return max(1, int(longest / (SLOT_SAMPLES * step_s)) // _ENOUGH_SLOTS)


def iterate(
    cameras: Sequence[LiftedCamera],
    first: Round,
    o: BundleOptions,
    *,
    step_s: float,
    tick: Callable[[float, Round], None],
) -> tuple[Round, ...] | Unconnected:
    """Rounds until neither persons nor cameras change; the last one is solved to the end.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
    first : Round
    o : BundleOptions
    step_s : float
    tick : callable
        Called before each round with the fraction done and the round before.

    Returns
    -------
    tuple of Round or Unconnected
        The first round and the last two; those between would only take memory. The latter as soon
        as cameras fall apart.
    """
    done = [first]
    for n in range(1, o.rounds):
        tick(n / o.rounds, done[-1])
        settled = n > 2 and _settled(done[-2], done[-1], step_s)
        last = settled or n == o.rounds - 1
        result = next_round(cameras, done[-1], o, step_s=step_s, last=last)
        if isinstance(result, Unconnected):
            return result
        done = [first, *done[1:][-1:], result]
        if last:
            break
    return tuple(done)


def _settled(before: Round, after: Round, step_s: float) -> bool:
    same = all(
        np.array_equal(a, b)
        for a, b in zip(before.association.person_of, after.association.person_of, strict=True)
    )
    baseline = float(np.linalg.norm(after.rig.t_ref_cam[1]))
    moved = np.linalg.norm(after.rig.t_ref_cam - before.rig.t_ref_cam, axis=-1).max() / baseline
    turned = np.abs(after.rig.R_ref_cam - before.rig.R_ref_cam).max()
    shifted = np.abs(after.rig.offset_s - before.rig.offset_s).max() / step_s
    return same and bool(max(moved, turned) < 1e-3 and shifted < 0.02)


def _round(
    cameras: Sequence[LiftedCamera],
    rig: Rig,
    association: Association,
    o: BundleOptions,
    step_s: float,
    *,
    tolerance: float,
    every_slot: int,
    max_points: int | None = None,
    drop: bool = False,
    last: bool = False,
) -> Round | Unconnected:
    observations = observe(cameras, rig, association, step_s=step_s)
    J = observations.x.shape[2]
    every = 1
    if max_points is not None:
        every = min(-(-len(observations.person) * J // max_points), J // 4) or 1
        observations = observations.every_joint(every)
    state = stba.initial_state(observations, rig)
    if drop:
        state = drop_outliers(observations, state, o)
    total = image_points([cameras[c] for c in rig.cameras]) // (every * every_slot)
    groups = connected(state.used, total)
    if len(groups) > 1:
        return Unconnected(tuple(groups))
    state = stba.adjust(
        observations,
        state,
        iterations=o.max_iterations,
        tolerance=tolerance,
        renew_velocities=last,
    )
    if drop:
        state = put_back(observations, state, iterations=o.max_iterations)
    if last:
        state = drop_outliers(observations, state, o)
    coverage = every_slot * J / observations.x.shape[2]
    return finish_round(rig, association, observations, state, total, coverage=coverage)


def finish_round(
    rig: Rig,
    association: Association,
    observations: Observations,
    state: stba.BundleState,
    total: IntArray,
    *,
    coverage: float = 1.0,
) -> Round:
    """The record of a round that started from a rig; `total` image points (C,) in all."""
    errors = stba.errors_px(observations, state)
    median = stba.median_error(errors, state.used)
    share = float((state.used.sum((0, 2)) / np.maximum(total, 1)).min())
    return Round(_rig_of(state, rig), association, observations, state, median, coverage, share)


def image_points(members: Sequence[LiftedCamera]) -> IntArray:
    """Image points (C,) of all tracks of some cameras, matched or not."""
    return np.array([sum(np.isfinite(t.x[..., 0]).sum() for t in m.tracks) for m in members])


def readjusted(before: Round, observations: Observations, o: BundleOptions, *, last: bool) -> Round:
    """A round whose images were taken at other times, adjusted to them from where it is."""
    known = before.state.used.sum(1) >= 2
    V, A = stba.motion(observations, before.state.X, known)
    state = drop_outliers(observations, replace(before.state, V=V, A=A), o)
    tolerance = _FINAL_TOLERANCE if last else _TOLERANCE
    state = stba.adjust(observations, state, iterations=o.max_iterations, tolerance=tolerance)
    return before.moved(observations, state)


def drop_outliers(o: Observations, state: stba.BundleState, b: BundleOptions) -> stba.BundleState:
    """Leave out observations above three times the median error (Section IV)."""
    errors = stba.errors_px(o, state)
    inside = np.isfinite(errors) & o.seen
    if not inside.any():
        return replace(state, used=inside)
    used = inside & (errors < outlier_limit_px(errors, state.used, b))
    return replace(state, used=used & (used.sum(1) >= 2)[:, None])


def outlier_limit_px(errors: FloatArray, used: BoolArray, b: BundleOptions) -> float:
    """Error above which an image point is an outlier, by the median of the used ones."""
    return max(b.outlier_floor_px, b.outlier_factor * stba.median_error(errors, used))


def connected(used: BoolArray, total: IntArray) -> list[tuple[int, ...]]:
    """Groups of cameras tied by common image points, largest group first.

    Two cameras are tied by a hundred points and a tenth of all that the one with fewer sees:
    a stray match of strangers is no tie.

    Parameters
    ----------
    used : (N, C, J) ndarray of bool
    total : (C,) ndarray of int
        Image points of each camera, matched or not.
    """
    seen = used.transpose(1, 0, 2).reshape(used.shape[1], -1).astype(np.float32)
    shared: FloatArray = seen @ seen.T
    needed = np.maximum(_MIN_SHARED_POINTS, _MIN_SHARE * np.minimum(total[:, None], total[None]))
    tied = shared >= needed
    left = list(range(len(shared)))
    groups: list[tuple[int, ...]] = []
    while left:
        group, frontier = [left[0]], [left[0]]
        while frontier:
            c = frontier.pop()
            new = [d for d in left if d not in group and tied[c, d]]
            group += new
            frontier += new
        left = [c for c in left if c not in group]
        groups.append(tuple(sorted(group)))
    return sorted(groups, key=lambda g: (-len(g), g))


def _rig_of(state: stba.BundleState, rig: Rig) -> Rig:
    R_ref_cam = np.swapaxes(state.R_cam_ref, -1, -2)
    return replace(
        rig,
        R_ref_cam=R_ref_cam,
        t_ref_cam=0.0 - np.einsum("cij,cj->ci", R_ref_cam, state.t_cam_ref),
        offset_s=rig.offset_s + state.shift_s,
    )


def _elsewhere(one: Rig, other: Rig, tolerance_s: float) -> BoolArray:
    """Cameras (C,) that stand, look or run elsewhere in another rig of the same cameras.

    By how much most of them are further away is the size that the people are taken for.
    """
    turned = rotation_angle(np.swapaxes(one.R_ref_cam, -1, -2) @ other.R_ref_cam)
    reach, its_reach = (np.linalg.norm(rig.t_ref_cam, axis=-1) for rig in (one, other))
    scale = np.median(reach[1:] / np.maximum(its_reach[1:], 1e-9))
    scale = np.clip(scale, 1 / _OTHER_SCALE, _OTHER_SCALE)
    apart = np.linalg.norm(one.t_ref_cam - scale * other.t_ref_cam, axis=-1)
    shifted = np.abs(one.offset_s - other.offset_s)
    moved = apart > _OTHER_POSITION + _OTHER_DISTANCE * reach
    return np.asarray((turned > _OTHER_ROTATION) | moved | (shifted > tolerance_s))


def _part(rig: Rig, cameras: IntArray) -> Rig:
    """The rig of the named cameras."""
    return sub_rig(rig, [int(np.flatnonzero(rig.cameras == c)[0]) for c in cameras])


def sub_rig(rig: Rig, members: Sequence[int]) -> Rig:
    """The rig of some of its cameras (positions), in the frame and clock of the first of them."""
    pick: IntArray = np.array(members, dtype=np.int64)
    R_0, t_0 = rig.R_ref_cam[pick[0]], rig.t_ref_cam[pick[0]]
    return replace(
        rig,
        cameras=rig.cameras[pick],
        R_ref_cam=R_0.T @ rig.R_ref_cam[pick],
        t_ref_cam=(rig.t_ref_cam[pick] - t_0) @ R_0,
        offset_s=rig.offset_s[pick] - rig.offset_s[pick[0]],
    )
