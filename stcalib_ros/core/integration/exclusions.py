"""Cameras that could not be connected to the others, with the reasons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.geometry.graphs import connected_groups
from stcalib_ros.core.integration.averaging import reliability
from stcalib_ros.core.integration.limits import MIN_PARALLAX
from stcalib_ros.core.model.calibration import Insufficient, Status, UncalibratedCamera
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rejection import Rejection, RejectionReason
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.model.rig import Rig, sub_rig


@dataclass(frozen=True, slots=True)
class Exclusions:
    """Cameras left out so far. A value: every change makes a new one.

    Attributes
    ----------
    names : tuple of str
        Names of all cameras of the recording.
    offset_range_s : float
        Range of the clock offsets, for what is said where nothing is left.
    cameras : tuple of UncalibratedCamera
    """

    names: tuple[str, ...]
    offset_range_s: float
    cameras: tuple[UncalibratedCamera, ...] = ()

    def adding(self, cameras: Sequence[int], rejection: Rejection) -> Exclusions:
        """Leave out some more."""
        more = tuple(UncalibratedCamera(self.names[c], rejection) for c in cameras)
        return replace(self, cameras=self.cameras + more)

    def reinstating(self, cameras: Sequence[int]) -> Exclusions:
        """Take some back, to be tried again."""
        back = [self.names[c] for c in cameras]
        return replace(self, cameras=tuple(one for one in self.cameras if one.name not in back))

    def because(self, reasons: Mapping[int, Rejection]) -> Exclusions:
        """Give other reasons for cameras that are left out."""
        return replace(
            self,
            cameras=tuple(
                UncalibratedCamera(one.name, reasons.get(self.names.index(one.name), one.rejection))
                for one in self.cameras
            ),
        )

    def _adding_groups(
        self, groups: Sequence[Sequence[int]], kept: Sequence[int], reason: RejectionReason
    ) -> Exclusions:
        others = tuple(self.names[c] for c in kept)
        grown = self
        for group in groups:
            cameras = tuple(self.names[c] for c in group)
            grown = grown.adding(group, Rejection(reason, cameras, others=others))
        return grown


def require_parallax(cameras: Sequence[LiftedCamera], hypotheses: Sequence[RelativePose]) -> None:
    """Require that not all cameras stand at one place.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    hypotheses : sequence of RelativePose

    Raises
    ------
    Insufficient
        The most reliable hypothesis of no pair of cameras places them apart.
    """
    best: dict[tuple[int, int], RelativePose] = {}
    for h in sorted(hypotheses, key=reliability):
        best[h.a, h.b] = h
    largest = max((parallax(cameras[h.a], h) for h in best.values()), default=float("inf"))
    if largest < MIN_PARALLAX:
        raise Insufficient(
            Status.DEGENERATE,
            Rejection(RejectionReason.NO_PARALLAX, measured=largest, limit=MIN_PARALLAX),
        )


def parallax(camera: LiftedCamera, h: RelativePose) -> float:
    """Return the distance of two cameras over that of the people from the first of them."""
    depths = np.concatenate([camera.tracks[p].root_cam[:, 2] for p, _ in h.matches])
    known = depths[np.isfinite(depths)]
    if not len(known):
        return float("inf")
    return float(np.linalg.norm(h.t_a_b) / np.median(known))


def largest_group(
    exclusions: Exclusions, cameras: Sequence[int], hypotheses: Sequence[RelativePose]
) -> tuple[list[int], Exclusions]:
    """Keep the cameras that are connected: the reference's group if it has two, else the largest.

    Parameters
    ----------
    exclusions : Exclusions
    cameras : sequence of int
        Cameras to choose from, the reference first.
    hypotheses : sequence of RelativePose
        Relative poses, each of which connects two cameras.

    Returns
    -------
    list of int
        The connected cameras, in the order given.
    Exclusions
        With the others added.

    Raises
    ------
    Insufficient
        No two cameras are connected.
    """
    position = {c: i for i, c in enumerate(cameras)}
    groups = connected_groups(cameras, hypotheses)
    kept = next((g for g in groups if cameras[0] in g and len(g) > 1), groups[0])
    left = [g for g in groups if g is not kept]
    grown = exclusions._adding_groups(left, kept, RejectionReason.DISCONNECTED)
    if len(kept) < 2:
        raise Insufficient(
            Status.INSUFFICIENT_DATA,
            Rejection(RejectionReason.NO_SHARED_MOTION, limit=exclusions.offset_range_s, unit="s"),
            grown.cameras,
        )
    return sorted(kept, key=lambda c: position[c]), grown


def largest_part(
    exclusions: Exclusions, rig: Rig, disconnected: Disconnected
) -> tuple[Rig, Exclusions]:
    """Keep the part of a rig that is connected; the reference's if it has two cameras.

    Raises
    ------
    Insufficient
        No two cameras are connected.
    """
    groups = disconnected.groups
    kept = next((g for g in groups if 0 in g and len(g) > 1), groups[0])
    grown = exclusions._adding_groups(
        [rig.cameras[list(g)].tolist() for g in groups if g is not kept],
        rig.cameras[list(kept)].tolist(),
        RejectionReason.UNMATCHED_OBSERVATIONS,
    )
    if len(kept) < 2:
        raise Insufficient(
            Status.INSUFFICIENT_DATA,
            Rejection(RejectionReason.NO_SHARED_OBSERVATIONS),
            grown.cameras,
        )
    return sub_rig(rig, kept), grown


@dataclass(frozen=True, slots=True, eq=False)
class Disconnected:
    """Groups of cameras (positions in the rig) that share too few observations; largest first."""

    groups: tuple[tuple[int, ...], ...]
