"""All cameras of a recording, lifted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from stcalib_ros.core.lifting.lift import lift_recording
from stcalib_ros.core.lifting.relens import with_lens
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import Intrinsics, Recording
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


def with_lenses(views: LiftedViews, lenses: Mapping[int, Intrinsics]) -> LiftedViews:
    """Return all cameras, some of them with other lenses.

    Parameters
    ----------
    views : LiftedViews
    lenses : mapping of int to Intrinsics
        By the index of the camera.
    """
    cameras, lifted = list(views.recording.cameras), list(views.lifted)
    for c, lens in lenses.items():
        cameras[c] = replace(cameras[c], intrinsics=lens)
        lifted[c] = with_lens(lifted[c], lens)
    recording = replace(views.recording, cameras=tuple(cameras))
    return replace(views, lifted=tuple(lifted), recording=recording)
