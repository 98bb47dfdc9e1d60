"""Whether enough motion has been seen to calibrate unasked; knows no ROS."""

from __future__ import annotations

import math
from collections.abc import Mapping, Set

from stcalib_ros.io.stamps import SAME_CLOCK, ClockCorrection
from stcalib_ros.ros.limits import GATHERING_S


def shared_motion_s(a: Set[int], b: Set[int], slack_s: float) -> int:
    """Count the seconds of `a` with motion in which `b` has motion, too, up to a clock difference.

    Examples
    --------
    >>> shared_motion_s({1, 2, 3, 9}, {3, 4}, 1.0)
    2
    """
    reach = math.ceil(slack_s)
    near = {second + d for second in b for d in range(-reach, reach + 1)}
    return len(a & near)


def shared_both_ways_s(a: Set[int], b: Set[int], slack_s: float) -> int:
    """Return the smaller of the seconds of `a` shared with `b`, and of `b` with `a`.

    Examples
    --------
    >>> shared_both_ways_s({1, 2, 3, 9}, {3, 4}, 1.0)
    2
    """
    return min(shared_motion_s(a, b, slack_s), shared_motion_s(b, a, slack_s))


def ready_cameras(
    moving: Mapping[str, Set[int]], *, min_motion_s: float, slack_s: float
) -> tuple[str, ...]:
    """Return the cameras that share enough motion; none while another one is gathering its own.

    Parameters
    ----------
    moving : mapping of str to set of int
        Whole seconds in which somebody moves, by camera.
    min_motion_s : float
        Seconds of motion that two cameras must share, counted either way.
    slack_s : float
        Difference that their clocks may have.

    Returns
    -------
    tuple of str
        A camera that has some motion but does not share enough, and saw some within the last
        `GATHERING_S`, is worth waiting for: none is ready then.
    """
    seeing = {name: seconds for name, seconds in moving.items() if seconds}
    ready = [
        a
        for a in seeing
        if any(
            shared_both_ways_s(seeing[a], seeing[b], slack_s) >= min_motion_s
            for b in seeing
            if b != a
        )
    ]
    newest = max((max(seconds) for seconds in seeing.values()), default=0)
    waiting = [
        n for n in seeing if n not in ready and max(seeing[n]) >= newest - GATHERING_S - slack_s
    ]
    return () if waiting else tuple(ready)


def moving_since(
    moving: Mapping[str, Set[int]], since_s: float, clocks: Mapping[str, ClockCorrection]
) -> dict[str, frozenset[int]]:
    """Return the seconds of motion after a time of the reference clock.

    Parameters
    ----------
    moving : mapping of str to set of int
        Whole seconds in which somebody moves, by camera and by its own clock.
    since_s : float
        Seconds since the Unix epoch, reference clock; -inf: all.
    clocks : mapping of str to ClockCorrection
        To the reference clock; they agree where this is unknown.
    """
    first_s = {name: clocks.get(name, SAME_CLOCK).camera_time(since_s) for name in moving}
    return {n: frozenset(s for s in seconds if s >= first_s[n]) for n, seconds in moving.items()}


class Trigger:
    """Decides when to calibrate unasked.

    All times are header stamps in seconds.
    """

    def __init__(self) -> None:
        self._tried: frozenset[str] = frozenset()
        self._at_s = -math.inf
        self._settled = False

    def due(self, ready: Set[str], now_s: float, *, period_s: float, window_s: float) -> bool:
        """Return whether to calibrate now.

        True when cameras are ready for the first time, when more of them have become ready, every
        `period_s` if that is not 0, and, while nothing is in force, with every new window of data.
        """
        if not ready:
            return False
        if not ready <= self._tried:
            return True
        self._at_s = min(self._at_s, now_s)
        wait_s = period_s if period_s > 0 else (math.inf if self._settled else window_s)
        return now_s - self._at_s >= wait_s

    def tried(self, ready: Set[str], now_s: float) -> None:
        """Note an attempt."""
        self._tried, self._at_s = self._tried | ready, now_s

    def settle(self, settled: bool) -> None:
        """Note whether a calibration is in force."""
        self._settled = settled
