"""How the caller follows a calibration, and stops it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.errors import Cancelled

Progress = Callable[[str, float], None]
"""Called with the name of the stage and the fraction of it that is done."""


@dataclass(frozen=True, slots=True)
class Control:
    """Callbacks of the caller.

    Attributes
    ----------
    progress : callable, optional
        Called with the name of the stage and the fraction of it that is done.
    cancelled : callable, optional
        Asked between steps; the calibration ends when it returns true.
    adjusted : callable, optional
        Called with the root mean square reprojection error so far, px.
    """

    progress: Progress | None = None
    cancelled: Callable[[], bool] | None = None
    adjusted: Callable[[float], None] | None = None

    def tick(self, stage: str, fraction: float) -> None:
        """Report progress.

        Raises
        ------
        Cancelled
            The caller wants to stop.
        """
        if self.cancelled is not None and self.cancelled():
            raise Cancelled(f"cancelled during {stage}")
        if self.progress is not None:
            self.progress(stage, fraction)

    def tick_iteration(self, fraction: float, latest: Iteration) -> None:
        """Report the progress of the adjustment, and its reprojection error so far."""
        if self.adjusted is not None:
            self.adjusted(latest.rms_px())
        self.tick("joint refinement", fraction)
