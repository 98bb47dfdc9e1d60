"""Initialization of the adjustment: the candidate rig that fits best, and any rival of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.limits import (
    CLOSE_SUPPORT,
    DECISIVE_FIT_GAIN,
    MAX_FIT_LOSS,
    MIN_EXPLAINED_TO_STOP,
    MIN_FIT_SCALE_PX,
    MIN_RIGS_TRIED,
    MIN_RIVAL_SUPPORT,
    OTHER_OFFSET_FRAMES,
    SAME_OFFSET_FRAMES,
)
from stcalib_ros.core.integration.exclusions import Exclusions
from stcalib_ros.core.model.calibration import Insufficient
from stcalib_ros.core.model.rig import Rig


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """An initial adjustment.

    Attributes
    ----------
    iteration : Iteration
    exclusions : Exclusions
        Cameras left out so far, those included that the adjustment disconnected.
    """

    iteration: Iteration
    exclusions: Exclusions


Adjust = Callable[[Rig, Exclusions], Start]
"""Makes the initial adjustment at a rig, without the cameras that are left out."""


def select_initial_rig(
    rigs: Sequence[Rig],
    adjust: Adjust,
    exclusions: Exclusions,
    tick: Callable[[str, float], None],
) -> tuple[Start, Iteration | None]:
    """Adjust candidate rigs initially; keep the best fit, and a rival that fits as well.

    Parameters
    ----------
    rigs : sequence of Rig
        Candidates, the best supported first.
    adjust : callable
        Makes the initial adjustment at a rig.
    exclusions : Exclusions
        Cameras left out before.
    tick : callable
        Called with the name of the stage and the fraction of it that is done.

    Returns
    -------
    Start
        The best.
    Iteration or None
        Another solution that fits about as well, if there is one.

    Raises
    ------
    Insufficient
        No rig stays connected.
    """
    starts = _initial_adjustments(rigs, adjust, exclusions, tick)
    fits = _fits(starts)
    best = max(fits)
    close = [
        s for s, fit in zip(starts, fits, strict=True) if fit >= best - MAX_FIT_LOSS * abs(best)
    ]
    close = _distinct(close)
    if len(close) > 1:
        close = [_repeated(start, adjust) for start in close]
    fits = _fits(close)
    first, *others = np.argsort([-fit for fit in fits], kind="stable").tolist()
    start = close[first]
    step_s = start.iteration.observations.step_s
    for k in others:
        rival = close[k].iteration
        n_other = len(start.iteration.differing(rival, OTHER_OFFSET_FRAMES * step_s))
        stake = abs(fits[first]) * n_other / len(start.iteration.rig.cameras)
        if n_other and fits[first] - fits[k] < DECISIVE_FIT_GAIN * stake:
            return start, rival
    return start, None


def _initial_adjustments(
    rigs: Sequence[Rig],
    adjust: Adjust,
    exclusions: Exclusions,
    tick: Callable[[str, float], None],
) -> list[Start]:
    """Adjust the best supported rigs: three, all that are close, or all while none explains enough.

    What is left of a rig without the reference is no rival of one that has it.
    """
    starts: list[Start] = []
    why: Insufficient | None = None
    for k, rig in enumerate(rigs):
        complete = any(
            start.iteration.explained_fraction > MIN_EXPLAINED_TO_STOP for start in starts
        )
        if starts and not _is_worth_trying(rig, rigs[0], k, complete=complete):
            break
        tick("first joint refinement", k / len(rigs))
        try:
            starts.append(adjust(rig, exclusions))
        except Insufficient as reason:
            why = why or reason
    if why is not None and not starts:
        raise why
    reference = rigs[0].cameras[0]
    return [s for s in starts if reference in s.iteration.rig.cameras] or starts


def _is_worth_trying(rig: Rig, best: Rig, k: int, *, complete: bool) -> bool:
    """Whether the k-th rig is to be adjusted, after others of which one explains enough or none."""
    if rig.support >= CLOSE_SUPPORT * best.support:
        return True
    return rig.support >= MIN_RIVAL_SUPPORT * best.support and (k < MIN_RIGS_TRIED or not complete)


def _distinct(starts: Sequence[Start]) -> list[Start]:
    """Drop starts that came to the same place as one that fits better."""
    fits = _fits(starts)
    kept: list[Start] = []
    for k in np.argsort([-fit for fit in fits], kind="stable").tolist():
        if not any(_same_solution(starts[k].iteration, other.iteration) for other in kept):
            kept.append(starts[k])
    return kept


def _same_solution(one: Iteration, other: Iteration) -> bool:
    """Whether two adjustments have the same cameras in the same places, to half a frame."""
    same = np.array_equal(one.rig.cameras, other.rig.cameras)
    differing = one.differing(other, SAME_OFFSET_FRAMES * one.observations.step_s)
    return same and not len(differing)


def _repeated(start: Start, adjust: Adjust) -> Start:
    """Adjust once more from where a start came to: people are associated better by then."""
    try:
        return adjust(start.iteration.rig, start.exclusions)
    except Insufficient:
        return start


def _fits(starts: Sequence[Start]) -> list[float]:
    """How well each start fits, all by the same measure."""
    scale_px = max(MIN_FIT_SCALE_PX, 2.0 * min(start.iteration.median_px for start in starts))
    return [start.iteration.fit(scale_px) for start in starts]
