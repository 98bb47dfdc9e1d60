"""What is known of the lens of a camera before calibration, and how well it is known afterwards."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from stcalib_ros.core.errors import InputError


class LensKnowledge(Enum):
    """What the intrinsics of a camera are worth.

    ``GIVEN`` ones stay as they are. ``REFINE``: they are a guess, by a data sheet or by another
    camera of the kind, and are estimated from there on. ``UNKNOWN``: only the size of the image is
    known.
    """

    GIVEN = "given"
    REFINE = "refine"
    UNKNOWN = "unknown"


def lens_knowledge(name: str, what: str) -> LensKnowledge:
    """Return what intrinsics are worth by its name.

    Parameters
    ----------
    name : str
    what : str
        Option or argument, for the error.

    Raises
    ------
    InputError
        There is nothing of that name.

    Examples
    --------
    >>> lens_knowledge("unknown", "intrinsics")
    <LensKnowledge.UNKNOWN: 'unknown'>
    """
    try:
        return LensKnowledge(name)
    except ValueError:
        names = [one.value for one in LensKnowledge]
        raise InputError(
            f"{what}: expected {', '.join(names[:-1])} or {names[-1]}, got {name!r}"
        ) from None


@dataclass(frozen=True, slots=True)
class LensStddev:
    """Standard deviations of an estimated lens; 0: not estimated.

    Attributes
    ----------
    focal_px : float
    cx_px, cy_px : float
    radial : tuple of float
        Of the first coefficients of radial distortion, k1 and on.
    """

    focal_px: float
    cx_px: float
    cy_px: float
    radial: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class LensPrior:
    """What is known of a lens that is to be estimated.

    Attributes
    ----------
    focal_px : float
    focal_stddev : float
        Relative standard deviation; infinite: nothing is known.
    centre_px : (float, float)
        Principal point.
    centre_stddev_px : float
    radial : tuple of float
        Coefficients of radial distortion that are estimated, k1 and on.
    radial_stddev : float
    """

    focal_px: float
    focal_stddev: float
    centre_px: tuple[float, float]
    centre_stddev_px: float
    radial: tuple[float, ...]
    radial_stddev: float
