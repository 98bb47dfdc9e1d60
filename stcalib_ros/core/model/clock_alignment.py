"""How the clocks of cameras are set before anything is compared: the option ``align``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from stcalib_ros.core.errors import InputError

MAX_SHIFT_S = 2.0**31
"""Seconds. No two times that stamps can hold are further apart: their seconds are int32. By
definition of ``builtin_interfaces/Time``."""

AUTO, STARTS, STAMPS = "auto", "starts", "stamps"


@dataclass(frozen=True, slots=True)
class ClockAlignment:
    """What is added to stamps before offsets are searched.

    Attributes
    ----------
    word : str
        ``auto``: a guess for cameras whose stamps do not overlap with those of the others;
        ``starts``: all cameras have their first image at one time; ``stamps``: nothing; empty:
        what follows.
    others_s : float
        Seconds, for every camera but the reference.
    cameras_s : mapping of str to float
        Seconds by camera, if not empty instead of `others_s`.
    """

    word: str = ""
    others_s: float = 0.0
    cameras_s: Mapping[str, float] = field(default_factory=dict)


def clock_alignment(text: str) -> ClockAlignment:
    """Read the option ``align``.

    Parameters
    ----------
    text : str
        A word of `ClockAlignment`, seconds, or seconds by camera: ``cam1=-3600.5,cam2=0.2``.

    Raises
    ------
    InputError
        It is none of these.

    Examples
    --------
    >>> clock_alignment("cam1=-3600.5").cameras_s
    {'cam1': -3600.5}
    """
    if text in (AUTO, STARTS, STAMPS):
        return ClockAlignment(text)
    try:
        if "=" not in text:
            return ClockAlignment(others_s=_seconds(text))
        parts = [part.rpartition("=") for part in text.split(",")]
        cameras_s = {name.strip(): _seconds(seconds) for name, _, seconds in parts}
    except ValueError:
        cameras_s = {}
    if not cameras_s or "" in cameras_s:
        raise InputError(
            f"option align must be {AUTO}, {STARTS}, {STAMPS}, the seconds to add to the stamps "
            f"of all cameras but the reference, or CAM=SECONDS,..., got {text!r}"
        )
    return ClockAlignment(cameras_s=cameras_s)


def _seconds(text: str) -> float:
    seconds = float(text)
    if not (math.isfinite(seconds) and abs(seconds) < MAX_SHIFT_S):
        raise ValueError(text)
    return seconds
