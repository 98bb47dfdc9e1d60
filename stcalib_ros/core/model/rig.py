"""A rig: poses and clock offsets of some cameras of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.recording import Intrinsics


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """Poses and time offsets of connected cameras.

    Attributes
    ----------
    cameras : (C,) ndarray of int
        Indices of the cameras; the first is the reference.
    R_ref_cam : (C, 3, 3) ndarray
    t_ref_cam : (C, 3) ndarray
        Camera centres, metres by body size.
    offset_s : (C,) ndarray
        ``t_ref = t_cam + offset_s``.
    support : float
        Weight of the hypotheses that agree.
    synchronised : bool
        The clocks are known to agree: offsets are zero and not estimated.
    lenses : tuple of Intrinsics, optional
        As they were estimated. Default: those that the cameras were lifted by.
    """

    cameras: IntArray
    R_ref_cam: Float64Array
    t_ref_cam: Float64Array
    offset_s: Float64Array
    support: float
    synchronised: bool = False
    lenses: tuple[Intrinsics, ...] = ()


def _part(rig: Rig, cameras: IntArray) -> Rig:
    """The rig of the named cameras."""
    return sub_rig(rig, [int(np.flatnonzero(rig.cameras == c)[0]) for c in cameras])


def sub_rig(rig: Rig, members: Sequence[int]) -> Rig:
    """The rig of some of its cameras (positions), in the frame and clock of the first of them."""
    pick: IntArray = np.array(members, dtype=np.int64)
    R_0, t_0 = rig.R_ref_cam[pick[0]], rig.t_ref_cam[pick[0]]
    return replace(
        rig,
        cameras=rig.cameras[pick],
        R_ref_cam=R_0.T @ rig.R_ref_cam[pick],
        t_ref_cam=(rig.t_ref_cam[pick] - t_0) @ R_0,
        offset_s=rig.offset_s[pick] - rig.offset_s[pick[0]],
        lenses=tuple(rig.lenses[i] for i in members) if rig.lenses else (),
    )
