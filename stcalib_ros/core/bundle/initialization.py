"""Where the adjustment starts: the rig that fits best, and another one if that fits as well."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.integration.exclusions import Exclusions
from stcalib_ros.core.model.calibration import UncalibratedCamera
from stcalib_ros.core.model.rejection import Insufficient
from stcalib_ros.core.model.rig import Rig

_RIVAL_SUPPORT = 0.5
_FEW_RIGS = 3
_COMPLETE = 0.6
_CLOSE = 0.3
_DECISIVE = 0.1
_OTHER_OFFSET_FRAMES = 3.0
_SAME_OFFSET_FRAMES = 0.5
_FIT_SCALE_PX = 12.0

_Start = tuple[Iteration, tuple[UncalibratedCamera, ...]]
"""A first round, and the cameras that fell off on the way to it."""


def select_initial_rig(
    rigs: Sequence[Rig],
    adjust: Callable[[Rig], Iteration],
    left_out: Exclusions,
    tick: Callable[[str, float], None],
) -> tuple[Iteration, Iteration | None]:
    """First adjustment of candidate rigs: the best fit, and a rival that fits as well.

    Parameters
    ----------
    rigs : sequence of Rig
        The best supported first.
    adjust : callable
        Makes the first round at a rig; adds the cameras that fall off to `left_out`.
    left_out : Exclusions
        Cameras that were left out before; afterwards with those that fell off the best.
    tick : callable
        Called with the name of the stage and the fraction of it that is done.

    Raises
    ------
    Insufficient
        No rig holds together.
    """
    starts = _first_rounds(rigs, adjust, left_out, tick)
    fits = _fits(starts)
    best = max(fits)
    close = [s for s, fit in zip(starts, fits, strict=True) if fit >= best - _CLOSE * abs(best)]
    close = _distinct(close)
    if len(close) > 1:
        close = [_repeated(start, adjust, left_out) for start in close]
    fits = _fits(close)
    first, *others = np.argsort([-fit for fit in fits], kind="stable").tolist()
    start, left_out.cameras = close[first]
    for k in others:
        n_other = start.differing(close[k][0], _OTHER_OFFSET_FRAMES * start.observations.step_s)
        stake = abs(fits[first]) * n_other / len(start.rig.cameras)
        if n_other and fits[first] - fits[k] < _DECISIVE * stake:
            return start, close[k][0]
    return start, None


def _first_rounds(
    rigs: Sequence[Rig],
    adjust: Callable[[Rig], Iteration],
    left_out: Exclusions,
    tick: Callable[[str, float], None],
) -> list[_Start]:
    """First rounds of the best supported rigs: of three, of all while none explains enough."""
    before = left_out.cameras
    starts: list[_Start] = []
    why: Insufficient | None = None
    for k, rig in enumerate(rigs):
        complete = any(start.share > _COMPLETE for start, _ in starts)
        supported = rig.support >= _RIVAL_SUPPORT * rigs[0].support
        if starts and not (supported and (k < _FEW_RIGS or not complete)):
            break
        tick("first adjustment", k / len(rigs))
        left_out.cameras = before
        try:
            starts.append((adjust(rig), left_out.cameras))
        except Insufficient as reason:
            why = why or reason
    if why is not None and not starts:
        raise why
    return starts


def _distinct(starts: Sequence[_Start]) -> list[_Start]:
    """Those that did not come to where one that fits better came to."""
    fits = _fits(starts)
    kept: list[_Start] = []
    for k in np.argsort([-fit for fit in fits], kind="stable").tolist():
        if not any(_alike(starts[k][0], other) for other, _ in kept):
            kept.append(starts[k])
    return kept


def _alike(one: Iteration, other: Iteration) -> bool:
    """Whether two rounds of the same cameras have them in the same places, to half a frame."""
    same = np.array_equal(one.rig.cameras, other.rig.cameras)
    return same and not one.differing(other, _SAME_OFFSET_FRAMES * one.observations.step_s)


def _repeated(start: _Start, adjust: Callable[[Rig], Iteration], left_out: Exclusions) -> _Start:
    """The same once more from where it came to: persons are found better by then."""
    left_out.cameras = start[1]
    try:
        return adjust(start[0].rig), left_out.cameras
    except Insufficient:
        return start


def _fits(starts: Sequence[_Start]) -> list[float]:
    """How well each fits, all by the same measure."""
    scale_px = max(_FIT_SCALE_PX, 2.0 * min(start.median_px for start, _ in starts))
    return [start.fit(scale_px) for start, _ in starts]
