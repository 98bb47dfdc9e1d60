"""All cameras of a recording, lifted."""

from __future__ import annotations

from dataclasses import dataclass

from stcalib_ros.core.lifting.lift import lift_recording
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.model.skeleton import Skeleton, common_skeleton
from stcalib_ros.core.options import Options


@dataclass(frozen=True, slots=True, eq=False)
class LiftedViews:
    """All cameras of a recording, ready to be compared pair by pair.

    Attributes
    ----------
    skeleton : Skeleton
    lifted : tuple of LiftedCamera
        In the order of the recording.
    """

    skeleton: Skeleton
    lifted: tuple[LiftedCamera, ...]


def lift_views(recording: Recording, options: Options) -> LiftedViews:
    """Bring the monocular poses of all cameras into their optical frames.

    The default method turns them onto their keypoints; the paper's takes them as they come,
    unless ``vmf.turn_poses`` is set.
    """
    turn = options.registration.method != "vmf" or options.vmf.turn_poses
    skeleton = common_skeleton(recording)
    lifted = lift_recording(
        recording,
        skeleton,
        min_score=options.min_score,
        turn=turn,
        rows=options.estimate_line_time,
        from_first_row=options.estimate_line_time and options.synchronised,
    )
    return LiftedViews(skeleton, lifted)
