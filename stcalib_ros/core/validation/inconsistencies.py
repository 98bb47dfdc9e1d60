"""What the residuals of one camera say against its own input: its lens, its clock, its pose.

A test of a camera asks whether another value of its own explains its residuals far better than the
one that it was given; each yields a `Rejection` with what that value is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rejection import Rejection, Remark
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.validation.lens_checks import lens_faults
from stcalib_ros.core.validation.pair_lens import pair_lens_faults
from stcalib_ros.core.validation.steadiness import unsteady_cameras


class CameraFaults(NamedTuple):
    """What is wrong with the input of one camera, the clearest first, and what does little harm."""

    rejections: tuple[Rejection, ...] = ()
    remarks: tuple[Remark, ...] = ()


def inconsistencies(
    cameras: Sequence[LiftedCamera], skeleton: Skeleton, last: Iteration, *, in_motion: bool = True
) -> tuple[CameraFaults, ...]:
    """Return what is wrong with the input of every camera of a rig.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    skeleton : Skeleton
    last : Iteration
    in_motion : bool
        Time offsets are determined. Where they are not, people who stand still or are exchanged
        look like anything through another lens.
    """
    results: list[Sequence[Rejection | Remark | None]] = [unsteady_cameras(cameras, last)]
    if in_motion:
        results += [lens_faults(cameras, last), pair_lens_faults(cameras, skeleton, last)]
    return tuple(map(_faults, zip(*results, strict=True)))


def _faults(found: Sequence[Rejection | Remark | None]) -> CameraFaults:
    rejections = [one for one in found if isinstance(one, Rejection)]
    rejections.sort(key=lambda why: -abs(why.measured / why.limit))
    return CameraFaults(tuple(rejections), tuple(one for one in found if isinstance(one, Remark)))
