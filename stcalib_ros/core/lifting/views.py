"""All cameras of a recording, lifted."""

from __future__ import annotations

from dataclasses import dataclass, replace

from stcalib_ros.core.lifting.lift import lift_recording
from stcalib_ros.core.lifting.relens import at_rig
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.model.rig import Rig
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
    recording : Recording
        What was lifted.
    """

    skeleton: Skeleton
    lifted: tuple[LiftedCamera, ...]
    recording: Recording


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
    return LiftedViews(skeleton, lifted, recording)


def with_lenses(views: LiftedViews, rig: Rig) -> LiftedViews:
    """Return all cameras, those of a rig with the lenses that were estimated.

    Parameters
    ----------
    views : LiftedViews
    rig : Rig
    """
    if not rig.lenses:
        return views
    lifted = at_rig(views.lifted, rig)
    cameras = list(views.recording.cameras)
    for c, lens in zip(rig.cameras.tolist(), rig.lenses, strict=True):
        cameras[c] = replace(cameras[c], intrinsics=lens)
    recording = replace(views.recording, cameras=tuple(cameras))
    return replace(views, lifted=lifted, recording=recording)
