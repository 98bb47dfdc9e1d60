"""Whether the node keeps up: how long messages wait, how long callbacks take; knows no ROS."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.ros.limits import LOAD_SPAN_S, MAX_SEQUENCE_GAP


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


class LossCounter:
    """Counts the messages that were published on a topic and never came.

    Publishers number their messages. What the network or a full queue lost is a gap in the
    numbers; numbers that go back are those of a publisher that has started anew.

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
        self._last: int | None = None

    def came(self, number: int | None) -> None:
        """Note the number of a message; None where the middleware has none."""
        if number is None:
            return
        if self._last is not None and 1 < number - self._last < MAX_SEQUENCE_GAP:
            self.lost += number - self._last - 1
        self._last = number


def _quantiles(values: Float64Array, percents: tuple[int, ...]) -> tuple[float, ...]:
    if not len(values):
        return (math.nan,) * len(percents)
    return tuple(float(v) for v in np.percentile(values, percents))
