"""Whether a clock has jumped, or runs at another rate than the calibration says.

A clock that runs 20 ppm fast is 50 ms ahead after 42 minutes. Each span measures the clock of a
camera to some milliseconds; before an alarm, a drift shows in them, a jump does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from stcalib_ros.core.monitoring.limits import (
    DRIFT_MEMORY_S,
    DRIFT_WEIGHT,
    MIN_DRIFT_FRACTION,
)


@dataclass(frozen=True, slots=True)
class ClockHistory:
    """What the spans without an alarm said about the clock of a camera.

    Attributes
    ----------
    last_s : float
        End of the last of them, seconds since the Unix epoch; NaN without any.
    advance_s : float
        How far the stamps were ahead, by the latest of them.
    gap_s, gap_end_s : float
        Last long time without a span, and the end of the span after it; 0 and NaN without one.
    """

    last_s: float = math.nan
    advance_s: float = 0.0
    gap_s: float = 0.0
    gap_end_s: float = math.nan

    def after(self, time_s: float, advance_s: float) -> ClockHistory:
        """Return the history with one more span, by which the stamps are that far ahead."""
        advance_s = self.advance_s + DRIFT_WEIGHT * (advance_s - self.advance_s)
        if not (gap_s := time_s - self.last_s) > DRIFT_MEMORY_S:
            return replace(self, last_s=time_s, advance_s=advance_s)
        return ClockHistory(time_s, advance_s, gap_s, time_s)

    def drifted(self, advance_s: float) -> bool:
        """Whether an advance that raises an alarm had come about before it, little by little."""
        return self.advance_s / advance_s >= MIN_DRIFT_FRACTION

    def unknown_s(self, end_s: float) -> float:
        """Return for how long nothing was known before a span with that end; 0 if not long."""
        known = self.after(end_s, 0.0) if not self.last_s >= end_s else self
        return known.gap_s if known.gap_end_s == end_s else 0.0
