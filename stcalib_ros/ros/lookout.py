"""Looks at who is there, in a thread of its own, while somebody wants to see it; knows no ROS."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.options import Options
from stcalib_ros.io.assemble import CameraImages
from stcalib_ros.io.stamps import SAME_CLOCK, ClockCorrection, corrections_of
from stcalib_ros.ros.common_time import common_time, part_between
from stcalib_ros.ros.limits import BACKWARDS_S, MAX_DELAY_S, SIGHT_EVERY_S, SIGHT_S
from stcalib_ros.ros.sightings import Sighting, look

_NOTHING = Sighting(-math.inf, -math.inf)


class Lookout:
    """Triangulates the people of the last second or two, again and again.

    All methods are called from one thread, and none of them waits.

    Parameters
    ----------
    warn : callable
        Called with what goes wrong.
    clock : callable
        Steady, seconds.

    Attributes
    ----------
    sight : Sighting
        The last one.
    """

    def __init__(
        self, warn: Callable[[str], object], *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._warn, self._clock = warn, clock
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="lookout")
        self._calibration: Calibration | None = None
        self._clocks: Mapping[str, ClockCorrection] = {}
        self._pending: Future[Sighting] | None = None
        self.sight = _NOTHING
        self._shown_s, self._ticked_s = -math.inf, 0.0

    def begin(self, calibration: Calibration | None) -> None:
        """Look by another calibration from now on, or not at all.

        Raises
        ------
        InputError
            A clock of the calibration stands still or runs backwards.
        """
        self._clocks = {} if calibration is None else corrections_of(calibration)
        self._calibration, self._pending = calibration, None
        self.sight, self._shown_s = _NOTHING, -math.inf

    @property
    def ready(self) -> bool:
        """There is a calibration, and no look is under way."""
        return self._calibration is not None and (self._pending is None or self._pending.done())

    def look(
        self, windows: Sequence[CameraImages], arriving: Mapping[str, float], options: Options
    ) -> None:
        """Take in the last look, and begin another one if there is enough that is new.

        Parameters
        ----------
        windows : sequence of CameraImages
            All images that there are.
        arriving : mapping of str to float
            Seconds since the last message of each camera.
        options : Options
        """
        self._take()
        if self._calibration is None or self._pending is not None:
            return
        common = common_time(windows, self._clocks, arriving)
        if common is None:
            return
        if common.end_s < self.sight.end_s - BACKWARDS_S:
            self.sight, self._shown_s = _NOTHING, -math.inf
        if common.end_s < self.sight.end_s + SIGHT_EVERY_S:
            return
        limits_s = (common.end_s - SIGHT_S, common.end_s)
        self._pending = self._thread.submit(
            look,
            [part_between(w, *limits_s, self._clocks.get(w.name, SAME_CLOCK)) for w in windows],
            self._calibration,
            self._clocks,
            options,
            limits_s=limits_s,
            before=self.sight,
        )

    def _take(self) -> None:
        if self._pending is None or not self._pending.done():
            return
        done, self._pending = self._pending, None
        if (error := done.exception()) is not None:
            self._warn(f"people cannot be shown: {type(error).__name__}: {error}")
            return
        self.sight = done.result()

    def time_to_show_s(self) -> float | None:
        """Return which time is to be shown now, seconds, reference clock; None: nothing is new.

        It passes as fast as time does, within what was looked at last.
        """
        now_s = self._clock()
        passed_s, self._ticked_s = now_s - self._ticked_s, now_s
        end_s = self.sight.end_s
        if not math.isfinite(end_s) or self._shown_s >= end_s:
            return None
        earliest_s = max(self.sight.start_s, end_s - MAX_DELAY_S)
        self._shown_s = min(max(self._shown_s + passed_s, earliest_s), end_s)
        return self._shown_s
