"""What the keypoints of a recording say about a calibration: people in 3D, and residuals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory, reconstruct
from stcalib_ros.core.stages import Stages


@dataclass(frozen=True, slots=True, eq=False)
class CaptureEvidence:
    """People of a recording as triangulated by a calibration, with all observations of them.

    Attributes
    ----------
    lifted : tuple of LiftedCamera
        All cameras; the rig of `last` says which of them are calibrated.
    last : Iteration
        Observations, triangulated joints and inliers.
    skeleton : Skeleton
    to_result : callable
        Transform of points (..., 3) from the frame and unit of `last` to those of the calibration.
    """

    lifted: tuple[LiftedCamera, ...]
    last: Iteration
    skeleton: Skeleton
    to_result: Callable[[Float64Array], Float64Array]

    @property
    def names(self) -> list[str]:
        """Names of the cameras, in the order of the observations."""
        return [self.lifted[c].name for c in self.last.rig.cameras]

    def trajectories(self) -> tuple[PersonTrajectory, ...]:
        """Return the joints of all persons in the frame and unit of the calibration."""
        return reconstruct(self.lifted, self.last, self.skeleton.layout, self.to_result)


def evidence_of(stages: Stages) -> CaptureEvidence | None:
    """Return what the adjustment itself ended with; None where no camera was calibrated."""
    if stages.placement is None:
        return None
    last, to_result = stages.iterations[-1], stages.placement.to_result
    return CaptureEvidence(stages.lifted, last, stages.skeleton, to_result)
