"""Checks what arrives against the calibration in force, in a thread of its own; knows no ROS."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.monitoring.alarms import State, Thresholds, Verdict, judge
from stcalib_ros.core.monitoring.drift import ClockHistory
from stcalib_ros.core.monitoring.limits import KEPT_SPANS, SPAN_S
from stcalib_ros.core.monitoring.noise import Noise
from stcalib_ros.core.monitoring.spans import Span, check_span
from stcalib_ros.io.assemble import CameraImages, Warn, assemble_recording
from stcalib_ros.io.stamps import SAME_CLOCK, ClockCorrection, corrections_of
from stcalib_ros.ros.common_time import common_time, part_between
from stcalib_ros.ros.limits import BACKWARDS_S, LATE_S, MIN_CAMERAS


class Watcher:
    """Looks at one span of time after the other; at most one is under examination.

    All methods are called from one thread, and none of them waits.

    Parameters
    ----------
    warn : callable
        Called with what goes wrong in the examination.
    """

    def __init__(self, warn: Warn) -> None:
        self._warn = warn
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="watch")
        self._calibration: Calibration | None = None
        self._clocks: Mapping[str, ClockCorrection] = {}
        self._verdicts: dict[str, Verdict] = {}
        self._spans: list[Span] = []
        self._pending: Future[Span] | None = None
        self._looked_until_s = -math.inf
        self._changed_s = -math.inf

    @property
    def verdicts(self) -> Mapping[str, Verdict]:
        """Verdicts on the cameras of the calibration in force, by name."""
        return self._verdicts

    @property
    def changed_s(self) -> float:
        """All data from this stamp on (reference clock) is from after the last change; or -inf."""
        return self._changed_s

    @property
    def busy(self) -> bool:
        """An examination is under way."""
        return self._pending is not None and not self._pending.done()

    @property
    def complaint(self) -> str:
        """Why the calibration in force does not hold any more; empty if it holds."""
        changed = {v.suspects or v.name: v for v in self._verdicts.values() if v.state.changed}
        return "; ".join(verdict.sentence() for verdict in changed.values())

    def begin(self, calibration: Calibration | None) -> None:
        """Watch another calibration from now on, or none.

        Raises
        ------
        InputError
            A clock of the calibration stands still or runs backwards.
        """
        self._clocks = {} if calibration is None else corrections_of(calibration)
        self._calibration, self._pending, self._spans = calibration, None, []
        cameras = () if calibration is None else calibration.cameras
        known = ClockHistory() if calibration is None else ClockHistory(calibration.window_s[1])
        self._verdicts = {camera.name: Verdict(camera.name, clock=known) for camera in cameras}

    def look(
        self,
        snapshot: Callable[[], Sequence[CameraImages]],
        arriving: Mapping[str, float],
        *,
        min_score: float,
    ) -> None:
        """Have the next span examined, if its images are there.

        Parameters
        ----------
        snapshot : callable
            Returns all images that there are.
        arriving : mapping of str to float
            Seconds since the last message of each camera.
        min_score : float
            Joints with a lower score are not used.
        """
        if self._calibration is None or self._pending is not None:
            return
        images = snapshot()
        common = common_time(images, self._clocks, arriving)
        if common is None:
            return
        end_s, lead_s = common.end_s, common.lead_s
        if end_s < self._looked_until_s - BACKWARDS_S:
            self._spans, self._looked_until_s, self._changed_s = [], -math.inf, -math.inf
        if end_s < self._looked_until_s + SPAN_S:
            return
        start_s = self._looked_until_s
        if end_s > start_s + 2.0 * SPAN_S:
            start_s = end_s - SPAN_S
        self._looked_until_s = start_s + SPAN_S
        parts = [
            part_between(c, start_s, start_s + SPAN_S, self._clocks.get(c.name, SAME_CLOCK))
            for c in images
        ]
        self._pending = self._thread.submit(
            _examined,
            [part for part in parts if part.images],
            self._calibration,
            start_s=start_s,
            min_score=min_score,
            lead_s={name: lead for name, lead in lead_s.items() if abs(lead) > LATE_S},
            noise=self._spans[-1].noise if self._spans else Noise(),
        )

    def news(self, thresholds: Thresholds) -> tuple[Verdict, ...]:
        """Take in what was found; return the verdicts that differ from those before.

        Of cameras that are suspected together, one speaks for all.
        """
        if self._pending is None or not self._pending.done():
            return ()
        done, self._pending = self._pending, None
        if (error := done.exception()) is not None:
            self._warn(f"the watch could not look at the last images: {error}")
            return ()
        self._spans = [*self._spans, done.result()][-KEPT_SPANS:]
        before, self._verdicts = self._verdicts, judge(self._spans, self._verdicts, thresholds)
        known = [v.since_s for v in self._verdicts.values() if math.isfinite(v.since_s)]
        self._changed_s = max([self._changed_s, *known])
        reported = {_statement(verdict) for verdict in before.values()}
        news = {_statement(verdict): verdict for verdict in self._verdicts.values()}
        return tuple(verdict for said, verdict in news.items() if said not in reported)


def _statement(verdict: Verdict) -> tuple[State, tuple[str, ...]]:
    return verdict.state, verdict.suspects or (verdict.name,)


def _examined(
    images: Sequence[CameraImages],
    calibration: Calibration,
    *,
    start_s: float,
    min_score: float,
    lead_s: Mapping[str, float],
    noise: Noise,
) -> Span:
    empty = Span(start_s, start_s + SPAN_S, {}, lead_s, noise)
    if len(images) < MIN_CAMERAS:
        return empty
    try:
        recording = assemble_recording(images, warn=lambda _: None)
    except InputError:  # the next calibration will report it; there is nothing to check here
        return empty
    return check_span(
        recording,
        calibration,
        start_s=start_s,
        end_s=start_s + SPAN_S,
        min_score=min_score,
        lead_s=lead_s,
        noise=noise,
    )
