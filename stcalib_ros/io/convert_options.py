"""How other people's poses become a recording: clocks, frame rate, joints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.limits import MAX_FRAME_RATE, MAX_TIME_S, MIN_FRAME_RATE
from stcalib_ros.io.plausible import require_name


@dataclass(frozen=True, slots=True)
class ConvertOptions:
    """How a source becomes a recording.

    Attributes
    ----------
    clock_shifts_s : mapping of str to float
        Seconds added to the stamps of a camera. If the reference camera's clock is not shifted, the
        camera's true ``time_offset_s`` is the negative of it: ``t_ref = t_cam + time_offset_s``.
    fps : float or None
        Frame rate; None: that of the source.
    layout : str or None
        Name of the joint layout; None: the one that has the joint names of the source.
    start_s : int
        Stamp of the first frame by an unshifted clock, Unix seconds.
    """

    clock_shifts_s: Mapping[str, float] = field(default_factory=dict)
    fps: float | None = None
    layout: str | None = None
    start_s: int = 1_760_000_000


def require_cameras(path: Path, names: Sequence[str], options: ConvertOptions) -> None:
    """Demand names that differ, and offsets of cameras that are there.

    Raises
    ------
    InputError
        A name or an offset is unusable; the message names it.
    """
    for name in names:
        require_name(name, f"{path}: name of a camera")
    if twice := sorted(n for n, count in Counter(names).items() if count > 1):
        raise InputError(f"{path}: two cameras have the same name: {', '.join(twice)}")
    if unknown := sorted(set(options.clock_shifts_s) - set(names)):
        raise InputError(
            f"offset of {', '.join(unknown)}: no such camera; {path} has {', '.join(names)}"
        )
    for name, shift in options.clock_shifts_s.items():
        if not abs(shift) <= MAX_TIME_S:
            raise InputError(
                f"offset of {name} must be a number of seconds within {MAX_TIME_S:.0f}, got {shift}"
            )


def require_rate(path: Path, fps: float) -> float:
    """Return a frame rate that a camera can have.

    Raises
    ------
    InputError
        It is none.
    """
    if not MIN_FRAME_RATE <= fps <= MAX_FRAME_RATE:
        raise InputError(
            f"{path}: frame rate is {fps}; give one of {MIN_FRAME_RATE} to {MAX_FRAME_RATE:.0f} Hz "
            "with --fps"
        )
    return fps


def require_stamps(path: Path, stamps_s: Iterable[float]) -> None:
    """Demand stamps that messages can hold, Unix seconds.

    Raises
    ------
    InputError
        One is before 1970 or after 2038.
    """
    stamps = list(stamps_s)
    first_s, last_s = min(stamps), max(stamps)
    if not 0 < first_s <= last_s < MAX_TIME_S:
        raise InputError(
            f"{path}: with this frame rate and these offsets, timestamps would be {first_s:.3g} "
            f"to {last_s:.3g} s, but only 0 to {MAX_TIME_S:.3g} s are possible"
        )
