"""What the residuals of one camera say against its own input: its lens, its clock, its pose.

A test of a camera asks whether another value of its own explains its residuals far better than the
one that it was given; each yields a `Rejection` with what that value is.
"""

from __future__ import annotations

from collections.abc import Sequence

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rejection import Rejection
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.validation.lens_checks import lens_faults
from stcalib_ros.core.validation.pair_lens import pair_lens_faults
from stcalib_ros.core.validation.steadiness import unsteady_cameras


def inconsistencies(
    cameras: Sequence[LiftedCamera], skeleton: Skeleton, last: Iteration, *, in_motion: bool = True
) -> tuple[tuple[Rejection, ...], ...]:
    """Return what is wrong with the input of every camera of a rig, the clearest first.

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
    results = [unsteady_cameras(cameras, last)]
    if in_motion:
        results += [lens_faults(cameras, last), pair_lens_faults(cameras, skeleton, last)]
    found = [
        [one for result in results if (one := result[c]) is not None]
        for c in range(len(last.rig.cameras))
    ]
    return tuple(
        tuple(sorted(each, key=lambda why: -abs(why.measured / why.limit))) for each in found
    )
