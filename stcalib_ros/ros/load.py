"""Whether the node keeps up: how long messages wait, how long callbacks take; knows no ROS."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.ros.limits import LOAD_SPAN_S, MAX_PUBLISHERS, MAX_SEQUENCE_GAP


@dataclass(frozen=True, slots=True)
class Load:
    """Load of the last minute, seconds; NaN where there was no message.

    Attributes
    ----------
    messages : int
        Number of pose messages.
    delay_p50_s, delay_p99_s, delay_max_s : float
        Time from the arrival of a message at this machine's end of DDS until it was taken in.
    hold_p99_s, hold_max_s : float
        Duration of the callbacks, of whatever kind; everything else waits for them.
    """

    messages: int
    delay_p50_s: float
    delay_p99_s: float
    delay_max_s: float
    hold_p99_s: float
    hold_max_s: float


class Meter:
    """Collects delays of the last minute.

    Parameters
    ----------
    clock : callable
        Steady, seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._new: tuple[list[float], list[float]] = ([], [])
        self._slices: deque[tuple[float, Float64Array, Float64Array]] = deque()

    def waited(self, delay_s: float) -> None:
        """Note how long a message has waited; the clock may have been set back meanwhile."""
        self._new[0].append(max(delay_s, 0.0))

    def held(self, hold_s: float) -> None:
        """Note how long a callback took."""
        self._new[1].append(hold_s)

    def timed(self, callback: Callable[[], None]) -> Callable[[], None]:
        """Return the callback, with its duration noted."""

        def called() -> None:
            begin = time.perf_counter()
            callback()
            self.held(time.perf_counter() - begin)

        return called

    def load(self) -> Load:
        """Return the figures of the last minute; to be called every second or so."""
        now_s = self._clock()
        self._slices.append((now_s, np.array(self._new[0]), np.array(self._new[1])))
        self._new = ([], [])
        while self._slices[0][0] <= now_s - LOAD_SPAN_S:
            self._slices.popleft()
        delays = np.concatenate([s[1] for s in self._slices])
        holds = np.concatenate([s[2] for s in self._slices])
        p50, p99, longest = _quantiles(delays, (50, 99, 100))
        return Load(len(delays), p50, p99, longest, *_quantiles(holds, (99, 100)))


@dataclass(slots=True, eq=False)
class _Publisher:
    """Where a publisher's numbers are.

    Attributes
    ----------
    last : int
        The last one.
    gap : (int, int)
        The numbers before and after its last gap.
    """

    last: int
    gap: tuple[int, int]

    def goes_on(self, number: int) -> int:
        """Add a number; return how many before it have not come."""
        skipped = number - self.last - 1
        if skipped:
            self.gap = (self.last, number)
        self.last = number
        return skipped


class LossCounter:
    """Counts the messages that were published on a topic and never came.

    Each publisher numbers its messages. What the network or a full queue lost is a gap in its
    numbers; a number that no publisher continues is that of another one, or of one that has
    started anew. Who has sent a message is not said: it continues the publisher whose last number
    is nearest below. What was taken for a loss is none if a number of the gap still comes: then it
    was the first message of another publisher.

    Examples
    --------
    >>> counter = LossCounter()
    >>> for number in (7, 8, 10, 1, 2, 4):
    ...     counter.came(number)
    >>> counter.lost
    2
    """

    def __init__(self) -> None:
        self.lost = 0
        self._publishers: list[_Publisher] = []

    def came(self, number: int | None) -> None:
        """Note the number of a message; None where the middleware has none."""
        if number is None:
            return
        one = self._before(number) or self._in_gap(number) or _Publisher(number, (number, number))
        self.lost += one.goes_on(number) if number > one.last else 0
        others = [p for p in self._publishers if p is not one]
        self._publishers = [*others[1 - MAX_PUBLISHERS :], one]

    def _before(self, number: int) -> _Publisher | None:
        """Return the publisher whose last number is nearest below."""
        below = [p for p in self._publishers if 0 < number - p.last < MAX_SEQUENCE_GAP]
        return max(below, key=lambda publisher: publisher.last, default=None)

    def _in_gap(self, number: int) -> _Publisher | None:
        """Return the publisher that goes on in the gap of another one, which then is none."""
        for other in self._publishers:
            before, after = other.gap
            if before < number < after:
                self.lost -= after - before - 1
                other.gap = (after, after)
                return _Publisher(before, (before, before))
        return None


def _quantiles(values: Float64Array, percents: tuple[int, ...]) -> tuple[float, ...]:
    if not len(values):
        return (math.nan,) * len(percents)
    return tuple(float(v) for v in np.percentile(values, percents))
