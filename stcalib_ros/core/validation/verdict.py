"""What is said of a calibration: its status, and one line for a person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.integration.exclusions import Exclusions
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.validation.camera_checks import CameraChecks
from stcalib_ros.core.validation.motion_ambiguity import find_ambiguity
from stcalib_ros.core.validation.recommendations import (
    least_constrained_camera,
    unobservable_clock_skews,
)


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """An adjustment that was brought to the end.

    Attributes
    ----------
    iterations : tuple of Iteration
    covariance : (7 C, 7 C) ndarray
    checks : tuple of CameraChecks
        Checks of the cameras of the rig.
    exclusions : Exclusions
        Cameras that were left out.
    doubt : str
        What speaks against the solution as a whole; empty if nothing does.
    """

    iterations: tuple[Iteration, ...]
    covariance: Float64Array
    checks: tuple[CameraChecks, ...]
    exclusions: Exclusions
    doubt: str = ""

    @property
    def last(self) -> Iteration:
        """The iteration that counts."""
        return self.iterations[-1]

    @property
    def sound(self) -> bool:
        """Whether every camera passes its checks."""
        return all(one.complaint() is None for one in self.checks)


def judge(
    cameras: Sequence[LiftedCamera],
    skeleton: Skeleton,
    solution: Solution,
    doubt: str,
) -> tuple[Status, str]:
    """Status of a calibration, and the message that goes with it.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    skeleton : Skeleton
    solution : Solution
    doubt : str
        What else speaks against it; empty if nothing does.
    """
    last = solution.last
    names = [cameras[c].name for c in last.rig.cameras]
    doubts = [
        f"{name}: {complaint}"
        for name, one in zip(names, solution.checks, strict=True)
        if (complaint := one.complaint())
    ]
    against = [text for text in (solution.doubt, "; ".join(doubts), doubt) if text]
    if against:
        open_questions = find_ambiguity(cameras, skeleton, last).sentences()
        return Status.DEGENERATE, "; ".join([against[0], *open_questions])
    step_s = last.observations.step_s
    if len(solution.iterations) > 1 and solution.iterations[-2].differing(last, step_s):
        message = "the adjustment had not settled after the last round: raise bundle.rounds"
        return Status.NOT_CONVERGED, message
    parts = [f"{len(names)} of {len(cameras)} cameras calibrated"]
    parts += [
        least_constrained_camera(names, solution.checks, last),
        unobservable_clock_skews(last),
    ]
    if solution.exclusions.cameras:
        parts += find_ambiguity(cameras, skeleton, last).sentences()
    return Status.OK, "; ".join(part for part in parts if part)


def rivalry(best: Iteration, other: Iteration, *, offset_range_s: float) -> str:
    """Say how two solutions that fit alike differ."""
    apart_s = best.clock_difference_s(other)
    frames = apart_s / best.observations.step_s
    what = (
        f"their clocks differ by {frames:.1f} frames ({apart_s:.2f} s)"
        if frames >= 1.0
        else "their poses differ"
    )
    return (
        f"two solutions fit about equally well, but {what}: motion that repeats itself, or "
        "people who move alike, do not tell them apart, or the true offset lies outside of "
        f"offset_range_s (+-{offset_range_s:g} s); set that to what is possible, "
        "or record more varied motion"
    )
