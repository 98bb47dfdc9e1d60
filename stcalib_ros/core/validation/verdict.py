"""The verdict on a solution: its status, with the reasons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stcalib_ros.core.bundle.covariance import JointCovariance
from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.integration.exclusions import Exclusions
from stcalib_ros.core.lifting.views import LiftedViews
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.validation.camera_checks import CameraChecks, rejection
from stcalib_ros.core.validation.motion_ambiguity import find_ambiguity
from stcalib_ros.core.validation.receipt_times import receipt_remarks
from stcalib_ros.core.validation.recommendations import (
    of_cameras,
    recommend,
    unobservable_clock_skews,
    without_poses,
)
from stcalib_ros.core.validation.thresholds import MAX_RMS_PX, MAX_RMS_RATIO


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """An adjustment that was brought to the end.

    Attributes
    ----------
    views : LiftedViews
        All cameras, with the lenses of the last iteration.
    iterations : tuple of Iteration
    covariance : (7 C, 7 C) ndarray
        Covariance of poses and time offsets.
    checks : tuple of CameraChecks
        Checks of the cameras of the rig.
    exclusions : Exclusions
        Cameras that were left out.
    unsettled : int
        Number of cameras that the last iteration before refinement still moved.
    rival : Rejection, optional
        Another solution that fits about as well.
    joint_covariance : JointCovariance, optional
        Covariance of everything that was estimated.
    """

    views: LiftedViews
    iterations: tuple[Iteration, ...]
    covariance: Float64Array
    checks: tuple[CameraChecks, ...]
    exclusions: Exclusions
    unsettled: int
    rival: Rejection | None = None
    joint_covariance: JointCovariance | None = None

    @property
    def last(self) -> Iteration:
        """The iteration that counts."""
        return self.iterations[-1]

    @property
    def sound(self) -> bool:
        """Whether every camera passes its checks."""
        return all(rejection(checks) is None for checks in self.checks)


@dataclass(frozen=True, slots=True)
class Judgement:
    """Status of a calibration, with the reasons.

    Attributes
    ----------
    status : Status
    rejections : tuple of Rejection
        Why it is not to be used, the most important first; with ``OK``, what explains that cameras
        were left out.
    remarks : tuple of Remark
        What could be better about a calibration that can be used.
    """

    status: Status
    rejections: tuple[Rejection, ...] = ()
    remarks: tuple[Remark, ...] = ()


def judge(
    cameras: Sequence[LiftedCamera],
    skeleton: Skeleton,
    solution: Solution,
    misaligned: Rejection | None,
) -> Judgement:
    """Judge a solution.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    skeleton : Skeleton
    solution : Solution
    misaligned : Rejection, optional
        Why scale or frame of the result are not determined.
    """
    last = solution.last
    names = [cameras[c].name for c in last.rig.cameras]
    failed = [
        rejection(checks, camera=name) for name, checks in zip(names, solution.checks, strict=True)
    ]
    # What is wrong with the input of a camera explains all else.
    pairs = zip(failed, solution.checks, strict=True)
    faulty = [found for found, checks in pairs if checks.inconsistencies]
    whole = (_large_residuals(last), solution.rival)
    others = [found for found in failed if found not in faulty]
    against = [found for found in (*faulty, *whole, *others, misaligned) if found is not None]
    if against:
        explained = find_ambiguity(cameras, skeleton, last).rejections()
        return Judgement(Status.DEGENERATE, (*against, *explained))
    if solution.unsettled:
        reason = RejectionReason.NOT_CONVERGED
        found = Rejection(reason, measured=float(solution.unsettled), limit=0.0, unit="cameras")
        return Judgement(Status.NOT_CONVERGED, (found,))
    remarks = (
        *recommend(names, solution.checks, last),
        *unobservable_clock_skews(last),
        *without_poses(names, solution.checks),
        *of_cameras(names, solution.checks),
        *receipt_remarks([cameras[c] for c in last.rig.cameras]),
    )
    left_out = solution.exclusions.cameras
    explained = find_ambiguity(cameras, skeleton, last).rejections() if left_out else ()
    rivals = tuple(
        one.rejection for one in left_out if one.rejection.reason is RejectionReason.RIVAL_SOLUTION
    )
    if rivals and explained:  # what is ambiguous about the others may be so about these as well
        return Judgement(Status.DEGENERATE, (rivals[0], *explained))
    return Judgement(Status.OK, explained, remarks)


def _large_residuals(last: Iteration) -> Rejection | None:
    """Return that the residuals of what counts as fitting are far above the usual one."""
    rms_px, limit = last.rms_px(), max(MAX_RMS_RATIO * last.median_px, MAX_RMS_PX)
    if not rms_px > limit:
        return None
    values = {"median_px": last.median_px}
    return Rejection(RejectionReason.LARGE_RESIDUALS, (), rms_px, limit, "px", values=values)


def unsettled_cameras(iterations: Sequence[Iteration]) -> int:
    """Return how many cameras the last iteration still moved, or whose clock by a frame.

    Parameters
    ----------
    iterations : sequence of Iteration
        Those of ISTBA. A refinement corrects biases that the iterations before it do not model, and
        so may move cameras further.
    """
    if len(iterations) < 2:
        return 0
    before, last = iterations[-2:]
    return len(before.differing(last, last.observations.step_s))


def rival_solution(best: Iteration, other: Iteration, *, offset_range_s: float) -> Rejection:
    """Return by how much two solutions that fit about equally well differ."""
    difference_s = best.clock_difference_s(other)
    return Rejection(
        RejectionReason.RIVAL_SOLUTION,
        measured=difference_s,
        unit="s",
        values={
            "frames": difference_s / best.observations.step_s,
            "offset_range_s": offset_range_s,
        },
    )
