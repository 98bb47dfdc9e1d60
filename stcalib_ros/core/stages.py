"""The results of every stage of a calibration."""

from __future__ import annotations

from dataclasses import dataclass

from stcalib_ros.core.bundle.covariance import JointCovariance
from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.output.world_frame import WorldAlignment
from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory, reconstruct


@dataclass(frozen=True, slots=True, eq=False)
class Stages:
    """Results of every stage; those after a failure are empty.

    Attributes
    ----------
    skeleton : Skeleton
    lifted : tuple of LiftedCamera
        All cameras, in the order of the recording.
    hypotheses : tuple of RelativePose
        Relative poses of all pairs of cameras: registered (PR), and refined ones beside them.
    rigs : tuple of Rig
        Candidates of the multi-view integration (MI), the best supported first.
    iterations : tuple of Iteration
        Iterations of the adjustment: the first (STBA) and the last two (ISTBA), the last one
        refined; where keypoints are biased, also the one before their correction.
    calibration : Calibration
    placement : WorldAlignment or None
        Unit and frame of the calibration; None without cameras.
    covariance : JointCovariance or None
        Joint covariance of everything that was estimated, by name, in the frame of the reference
        camera and the unit of the adjustment; None without cameras, and with
        ``registration.method`` "vmf".
    """

    skeleton: Skeleton
    lifted: tuple[LiftedCamera, ...]
    hypotheses: tuple[RelativePose, ...]
    rigs: tuple[Rig, ...]
    iterations: tuple[Iteration, ...]
    calibration: Calibration
    placement: WorldAlignment | None = None
    covariance: JointCovariance | None = None

    def trajectories(self) -> tuple[PersonTrajectory, ...]:
        """Return the joints of all persons in the frame and unit of the calibration."""
        if self.placement is None:
            return ()
        return reconstruct(
            self.lifted, self.iterations[-1], self.skeleton.layout, self.placement.to_result
        )
