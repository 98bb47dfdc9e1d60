"""Warnings that repeat themselves only now and then; knows no ROS."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from stcalib_ros.ros.limits import REPEAT_S


class Throttle:
    """Passes on a warning unless one about the same subject was passed on a moment ago.

    Parameters
    ----------
    warn : callable
        Takes the warnings that are passed on.
    clock : callable
        Steady, seconds.
    """

    def __init__(
        self, warn: Callable[[str], object], *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._warn, self._clock = warn, clock
        self._due_s: dict[str, float] = {}

    def __call__(self, subject: str, line: str, *, every_s: float = REPEAT_S) -> None:
        """Warn in one line."""
        now_s = self._clock()
        if now_s >= self._due_s.get(subject, -math.inf):
            self._due_s[subject] = now_s + every_s
            self._warn(line)

    def not_before(self, subject: str, delay_s: float) -> None:
        """Pass nothing on about a subject for some time from now."""
        self._due_s[subject] = self._clock() + delay_s
