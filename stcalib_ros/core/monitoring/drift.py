"""Whether a clock has jumped, or runs at another rate than the calibration says.

A clock that runs 20 ppm fast is 50 ms ahead after 42 minutes. Each span measures the clock of a
camera to some milliseconds; before an alarm, a drift shows in them, a jump does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from stcalib_ros.core.monitoring.limits import (
    DRIFT_MEMORY_S,
    MIN_DRIFT_FRACTION,
    MIN_GAP_S,
    RECENT_SPANS,
)


@dataclass(frozen=True, slots=True)
class ClockHistory:
    """What the spans without an alarm said about the clock of a camera.

    Attributes
    ----------
    last_s : float
        End of the last of them, seconds since the Unix epoch; NaN without any.
    recent : tuple of (float, float)
        The last of them, up to `limits.RECENT_SPANS`, by which a jump may be confirmed: their ends
        and how far the stamps were ahead.
    settled_s, settled_advance_s : float
        How far the stamps were ahead before these, a mean of the latest, and when.
    gap_s, gap_end_s : float
        Last long time without a span, and the end of the span after it; 0 and NaN without one.
    """

    last_s: float = math.nan
    recent: tuple[tuple[float, float], ...] = ()
    settled_s: float = math.nan
    settled_advance_s: float = 0.0
    gap_s: float = 0.0
    gap_end_s: float = math.nan

    def after(self, time_s: float, advance_s: float) -> ClockHistory:
        """Return the history with one more span, by which the stamps are that far ahead."""
        known = replace(self, last_s=time_s, recent=(*self.recent, (time_s, advance_s)))
        if (gap_s := time_s - self.last_s) > MIN_GAP_S:
            known = replace(known, gap_s=gap_s, gap_end_s=time_s)
        return known._settled() if len(known.recent) > RECENT_SPANS else known

    def _settled(self) -> ClockHistory:
        """Add the oldest of the recent spans to the mean, by the time since the one before."""
        (time_s, advance_s), *recent = self.recent
        since_s = max(time_s - self.settled_s, 0.0)
        weight = 1.0 if math.isnan(self.settled_s) else -math.expm1(-since_s / DRIFT_MEMORY_S)
        mean_s = self.settled_advance_s + weight * (advance_s - self.settled_advance_s)
        return replace(self, recent=tuple(recent), settled_s=time_s, settled_advance_s=mean_s)

    def drifted(self, advance_s: float) -> bool:
        """Whether an advance that raises an alarm had come about before it, little by little."""
        return self.settled_advance_s / advance_s >= MIN_DRIFT_FRACTION

    def unknown_s(self, end_s: float) -> float:
        """Return for how long nothing was known before a span with that end; 0 if not long."""
        known = self.after(end_s, 0.0) if not self.last_s >= end_s else self
        return known.gap_s if known.gap_end_s == end_s else 0.0
