"""Clocks that differ by more than is searched: UTC against the time since boot, or hours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.lifting.limits import MIN_RECEIPT_DELAY_S
from stcalib_ros.core.model.clock_alignment import AUTO, STAMPS, STARTS, clock_alignment
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.core.model.rejection import Remark, RemarkCode
from stcalib_ros.core.options import Options

_BY_RECEIPT = "which overlap with no others, by the times at which images were received"
_BY_STARTS = "which overlap with no others, as if cameras had started together"
_ASKED = "as if cameras had started together"


@dataclass(frozen=True, slots=True, eq=False)
class AlignedClocks:
    """A recording whose clocks are near each other, as far as they can be guessed.

    Attributes
    ----------
    recording : Recording
    shifts_s : mapping of str to float
        What was added to the stamps of cameras, by name.
    remarks : tuple of Remark
        What was guessed.
    """

    recording: Recording
    shifts_s: Mapping[str, float] = field(default_factory=dict)
    remarks: tuple[Remark, ...] = ()


@dataclass(frozen=True, slots=True)
class _Guess:
    """Seconds to add to the stamps of cameras, and by what they were guessed."""

    cameras: tuple[str, ...]
    seconds: float
    why: str


def with_aligned_clocks(recording: Recording, options: Options) -> AlignedClocks:
    """Add to the stamps of cameras what `Options.align` says, before offsets are searched.

    Parameters
    ----------
    recording : Recording
    options : Options

    Raises
    ------
    InputError
        A camera that ``align`` names is not in the recording.
    """
    names = [camera.name for camera in recording.cameras]
    reference = options.reference or names[0]
    alignment = clock_alignment(options.align)
    if unknown := [name for name in alignment.cameras_s if name not in names]:
        raise InputError(
            f"option align: no camera {unknown[0]!r} in the recording: there are {', '.join(names)}"
        )
    seeing = [c for c in recording.cameras if c.tracks and len(c.stamps)]
    guesses: tuple[_Guess, ...] = ()
    if alignment.word == STARTS:
        guesses = _starts(seeing, reference)
    elif alignment.word == AUTO and not options.synchronised:
        guesses = _of_groups(_groups(seeing, 2.0 * options.offset_range_s), reference)
    elif alignment.word not in (AUTO, STAMPS):
        others_s = {name: alignment.others_s for name in names if name != reference}
        given = alignment.cameras_s or others_s
        return AlignedClocks(_shifted(recording, given), given)
    shifts = {name: guess.seconds for guess in guesses for name in guess.cameras}
    if not shifts:
        return AlignedClocks(recording)
    return AlignedClocks(
        _shifted(recording, shifts), shifts, tuple(_remark(guess, options) for guess in guesses)
    )


def _shifted(recording: Recording, shifts_s: Mapping[str, float]) -> Recording:
    return replace(
        recording,
        cameras=tuple(
            replace(c, stamps=c.stamps + shifts_s[c.name]) if c.name in shifts_s else c
            for c in recording.cameras
        ),
    )


def _remark(guess: _Guess, options: Options) -> Remark:
    values = {"seconds": guess.seconds, "range_s": options.offset_range_s}
    return Remark(RemarkCode.CLOCKS_ALIGNED, guess.cameras, values, guess.why)


def _starts(cameras: Sequence[CameraRecording], reference: str) -> tuple[_Guess, ...]:
    begin = next((c.stamps[0] for c in cameras if c.name == reference), None)
    if begin is None:
        return ()
    return tuple(
        _Guess((c.name,), float(begin - c.stamps[0]), _ASKED)
        for c in cameras
        if c.name != reference
    )


def _groups(cameras: Sequence[CameraRecording], reach_s: float) -> list[list[CameraRecording]]:
    """Return cameras by stretches of time between which there is more than what can be bridged."""
    ordered = sorted(cameras, key=lambda c: float(c.stamps[0]))
    if not ordered:
        return []
    ends = np.maximum.accumulate([c.stamps[-1] for c in ordered])
    groups = [[ordered[0]]]
    for k, (_, camera) in enumerate(pairwise(ordered)):
        if camera.stamps[0] - ends[k] > reach_s:
            groups.append([])
        groups[-1].append(camera)
    return groups


def _of_groups(groups: Sequence[Sequence[CameraRecording]], reference: str) -> tuple[_Guess, ...]:
    """Guess the clocks of all groups but that of the reference, or the largest without one."""
    base = next((g for g in groups if any(c.name == reference for c in g)), None)
    base = base or max(groups, key=len, default=[])
    found = (_guess(group, base) for group in groups if group is not base)
    return tuple(guess for guess in found if guess is not None)


def _guess(group: Sequence[CameraRecording], base: Sequence[CameraRecording]) -> _Guess | None:
    """Guess what to add to the stamps of a group; None where it was recorded at another time."""
    names = tuple(camera.name for camera in group)
    mine, others = _receipt(group), _receipt(base)
    if mine is None or others is None:
        begin, begin_base = (min(float(c.stamps[0]) for c in g) for g in (group, base))
        return _Guess(names, begin_base - begin, _BY_STARTS)
    if mine.begin > others.end or others.begin > mine.end:
        return None
    return _Guess(names, mine.delay - others.delay, _BY_RECEIPT)


@dataclass(frozen=True, slots=True)
class _Receipt:
    """First and last time of receipt by the recorder's clock, and by how much it is later."""

    begin: float
    end: float
    delay: float


def _receipt(group: Sequence[CameraRecording]) -> _Receipt | None:
    """Return when the images of a group were received; None where nobody knows.

    A bag that was made of files, not recorded, has its stamps as times of receipt.
    """
    known = [
        (c.received[fits], c.stamps[fits])
        for c in group
        if c.received is not None and (fits := np.isfinite(c.received)).any()
    ]
    if not known:
        return None
    received, stamps = (np.concatenate(column) for column in zip(*known, strict=True))
    delay = received - stamps
    if np.abs(delay).max() < MIN_RECEIPT_DELAY_S:
        return None
    return _Receipt(float(received.min()), float(received.max()), float(np.median(delay)))
