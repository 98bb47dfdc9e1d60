"""The results of every stage of a calibration."""

from __future__ import annotations

from dataclasses import dataclass

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
        In the order of the recording.
    hypotheses : tuple of RelativePose
        Of all pairs of cameras: registered (PR), and refined ones beside them.
    rigs : tuple of Rig
        Of the multi-view integration (MI), best first.
    rounds : tuple of Iteration
        Of the adjustment, the first and the last two: the first is STBA, the others ISTBA; where
        key points lean one way, one more without that.
    calibration : Calibration
    placement : WorldAlignment or None
        How the calibration lies in the world; None without cameras.
    """

    skeleton: Skeleton
    lifted: tuple[LiftedCamera, ...]
    hypotheses: tuple[RelativePose, ...]
    rigs: tuple[Rig, ...]
    rounds: tuple[Iteration, ...]
    calibration: Calibration
    placement: WorldAlignment | None = None

    def trajectories(self) -> tuple[PersonTrajectory, ...]:
        """Return the joints of all persons in the frame and unit of the calibration."""
        if self.placement is None:
            return ()
        return reconstruct(
            self.lifted, self.rounds[-1], self.skeleton.layout, self.placement.to_result
        )
