"""Lengths that somebody has measured, by which a calibration becomes metric."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from stcalib_ros.core.errors import InputError

Ends = tuple[tuple[float, float], tuple[float, float]]

MAX_METRES = 1e6
"""Metres. A longer distance is none between cameras that see the same people. Chosen."""

_KEYS = ("metres", "sigma_m", "cameras", "points")


@dataclass(frozen=True, slots=True)
class Distance:
    """A known distance: between two cameras, or between two points that do not move.

    Attributes
    ----------
    metres, sigma_m : float
    cameras : tuple of str
        Two names; or none, and the distance is between two points.
    points : mapping of str to ((float, float), (float, float))
        Pixels of both ends in each of at least two cameras.
    """

    metres: float
    sigma_m: float
    cameras: tuple[str, ...] = ()
    points: Mapping[str, Ends] | None = None

    def __post_init__(self) -> None:
        if not (0 < self.sigma_m < self.metres <= MAX_METRES):
            raise InputError(
                f"scale.distances: metres must be above 0 and at most {MAX_METRES:.0f}, and "
                f"sigma_m between 0 and metres, got {self.metres} and {self.sigma_m}"
            )
        given = len(self.points or ())
        if (len(set(self.cameras)) != 2 or given) and (self.cameras or given < 2):
            raise InputError(
                "scale.distances: each needs either two cameras or the points of at least two "
                f"cameras, got cameras {list(self.cameras)} and points of {given} cameras"
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the cameras concerned."""
        return self.cameras or tuple(self.points or ())


def distances_from_list(given: Any, path: str) -> tuple[Distance, ...]:
    """Distances from a list of mappings, as a YAML file gives it.

    Parameters
    ----------
    given : list of mapping
        ``metres``, ``sigma_m`` and either ``cameras: [a, b]`` or ``points: {a: [[u, v], [u, v]],
        b: ...}``.
    path : str
        For error messages.

    Raises
    ------
    InputError
        An entry is unusable; the message shows it.
    """
    if isinstance(given, str) or not isinstance(given, Sequence):
        raise InputError(f"option {path}: expected a list of distances, got {given!r}")
    return tuple(_distance(entry, f"option {path}[{i}]") for i, entry in enumerate(given))


def _distance(entry: Any, where: str) -> Distance:
    if not isinstance(entry, Mapping) or not {"metres", "sigma_m"} <= set(entry) <= set(_KEYS):
        raise InputError(
            f"{where}: expected metres, sigma_m and either cameras or points, got {entry!r}"
        )
    try:
        return Distance(
            float(entry["metres"]),
            float(entry["sigma_m"]),
            tuple(str(name) for name in entry.get("cameras", ())),
            {str(name): _ends(ends) for name, ends in entry.get("points", {}).items()},
        )
    except (TypeError, ValueError, OverflowError, AttributeError):
        raise InputError(
            f"{where}: points are two pixels by camera, {{cam0: [[u, v], [u, v]], ...}}, got "
            f"{entry!r}"
        ) from None


def _ends(ends: Any) -> Ends:
    (u0, v0), (u1, v1) = ends
    pixels = (float(u0), float(v0)), (float(u1), float(v1))
    if not all(math.isfinite(number) for pixel in pixels for number in pixel):
        raise ValueError
    return pixels
