"""Cameras that cannot be tied to the others, with the reasons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stcalib_ros.core.geometry.graphs import connected_groups
from stcalib_ros.core.model.calibration import Status, UncalibratedCamera
from stcalib_ros.core.model.rejection import Insufficient
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.model.rig import Rig, sub_rig


class Exclusions:
    """Cameras that were left out on the way.

    Parameters
    ----------
    names : sequence of str
        Of all cameras.
    offset_range_s : float
        For what is said where nothing is left.

    Attributes
    ----------
    cameras : tuple of UncalibratedCamera
        So far; may be set back to what it was before.
    """

    def __init__(self, names: Sequence[str], *, offset_range_s: float) -> None:
        self._names, self._offset_range_s = tuple(names), offset_range_s
        self.cameras: tuple[UncalibratedCamera, ...] = ()

    def add(self, cameras: Sequence[int], reason: str) -> None:
        """Leave some out."""
        self.cameras += tuple(UncalibratedCamera(self._names[c], reason) for c in cameras)

    def reinstate(self, cameras: Sequence[int]) -> None:
        """Some are to be tried again."""
        back = [self._names[c] for c in cameras]
        self.cameras = tuple(one for one in self.cameras if one.name not in back)

    def largest_group(
        self, cameras: Sequence[int], hypotheses: Sequence[RelativePose]
    ) -> list[int]:
        """The cameras that hang together: the reference's group if it has two, else the largest.

        Raises
        ------
        Insufficient
            No two do.
        """
        position = {c: i for i, c in enumerate(cameras)}
        groups = connected_groups(cameras, hypotheses)
        kept = next((g for g in groups if cameras[0] in g and len(g) > 1), groups[0])
        self._add_groups([g for g in groups if g is not kept], kept, "shares nobody's motion with")
        if len(kept) < 2:
            raise Insufficient(
                Status.INSUFFICIENT_DATA,
                "no two cameras see the same person move: check that their views overlap, that "
                f"their clocks agree within {self._offset_range_s:g} s (offset_range_s), "
                "and record longer",
                self.cameras,
            )
        return sorted(kept, key=lambda c: position[c])

    def largest_part(self, rig: Rig, apart: Disconnected) -> Rig:
        """The part of a rig that holds together; the reference's if it has two cameras.

        Raises
        ------
        Insufficient
            No two cameras hold together.
        """
        groups = apart.groups
        kept = next((g for g in groups if 0 in g and len(g) > 1), groups[0])
        self._add_groups(
            [rig.cameras[list(g)].tolist() for g in groups if g is not kept],
            rig.cameras[list(kept)].tolist(),
            "hardly anything that it sees matches what is seen by",
        )
        if len(kept) < 2:
            raise Insufficient(
                Status.INSUFFICIENT_DATA,
                "people could not be matched across views: too few of their image points fit any "
                "two cameras; check the intrinsics, let views overlap more, and record longer",
                self.cameras,
            )
        return sub_rig(rig, kept)

    def _add_groups(
        self, groups: Sequence[Sequence[int]], kept: Sequence[int], lacking: str
    ) -> None:
        names = ", ".join(self._names[c] for c in kept)
        for group in groups:
            for c in group:
                reason = f"{lacking} {names}"
                if others := [self._names[d] for d in group if d != c]:
                    reason += f"; it forms a separate group with {', '.join(others)}"
                self.add([c], reason)


@dataclass(frozen=True, slots=True, eq=False)
class Disconnected:
    """Groups of cameras (positions in the rig) that share too few image points; largest first."""

    groups: tuple[tuple[int, ...], ...]
