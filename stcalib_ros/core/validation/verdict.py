"""What is said of a calibration: its status, and one line for a person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Status, UncalibratedCamera
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
    rounds : tuple of Iteration
    covariance : (7 C, 7 C) ndarray
    evidence : tuple of CameraChecks
        Of the cameras of the rig.
    left_out : tuple of UncalibratedCamera
    """

    rounds: tuple[Iteration, ...]
    covariance: Float64Array
    evidence: tuple[CameraChecks, ...]
    left_out: tuple[UncalibratedCamera, ...]

    @property
    def last(self) -> Iteration:
        """The round that counts."""
        return self.rounds[-1]

    @property
    def sound(self) -> bool:
        """No camera has to be doubted."""
        return all(one.complaint() is None for one in self.evidence)


def judge(
    cameras: Sequence[LiftedCamera],
    skeleton: Skeleton,
    solution: Solution,
    complaints: Sequence[str],
) -> tuple[Status, str]:
    """Status of a calibration, and the message that goes with it.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    skeleton : Skeleton
    solution : Solution
    complaints : sequence of str
        What else speaks against it; empty ones do not count. The first one is said.
    """
    last = solution.last
    names = [cameras[c].name for c in last.rig.cameras]
    doubts = [
        f"{name}: {complaint}"
        for name, one in zip(names, solution.evidence, strict=True)
        if (complaint := one.complaint())
    ]
    against = [text for text in (complaints[0], "; ".join(doubts), *complaints[1:]) if text]
    if against:
        open_questions = find_ambiguity(cameras, skeleton, last).sentences()
        return Status.DEGENERATE, "; ".join([against[0], *open_questions])
    step_s = last.observations.step_s
    if len(solution.rounds) > 1 and solution.rounds[-2].differing(last, step_s):
        message = "the adjustment had not settled after the last round: raise bundle.rounds"
        return Status.NOT_CONVERGED, message
    parts = [f"{len(names)} of {len(cameras)} cameras calibrated"]
    parts += [
        least_constrained_camera(names, solution.evidence, last),
        unobservable_clock_skews(last),
    ]
    if solution.left_out:
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
