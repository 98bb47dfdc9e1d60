"""The calibration in force: published, kept on disk, and found there after a restart."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.io.history import History, Kept
from stcalib_ros.io.stamps import ClockCorrection, corrections_of
from stcalib_ros.ros.publishers import Publishers


class InForce:
    """Holds the calibration in force and its history.

    Parameters
    ----------
    history : History
    cameras : iterable of str
        Configured cameras: a calibration of others is not used.
    publishers : Publishers
    message : callable
        Returns the ``CalibrationResult`` of a calibration and the id of its run.
    log : rclpy's logger
    """

    def __init__(
        self,
        history: History,
        cameras: Iterable[str],
        publishers: Publishers,
        message: Callable[[Calibration, str], Any],
        log: Any,
    ) -> None:
        self._history, self._cameras = history, frozenset(cameras)
        self._publishers, self._message, self._log = publishers, message, log
        self._kept: Kept | None = None
        self._clocks: Mapping[str, ClockCorrection] = {}
        self._run_id = ""

    @property
    def calibration(self) -> Calibration | None:
        """The calibration in force; None if there is none."""
        return None if self._kept is None else self._kept.calibration

    @property
    def run_id(self) -> str:
        """Id of its run; empty if there is none."""
        return self._run_id

    @property
    def clocks(self) -> Mapping[str, ClockCorrection]:
        """Corrections to the reference clock by name of camera."""
        return self._clocks

    def load(self) -> None:
        """Put the last saved calibration into force, if there is one that can be used."""
        try:
            kept = self._history.latest()
            if kept is None:
                return
            self._require_usable(kept)
        except InputError as error:
            self._log.error(f"the saved calibration is not used: {error}")
            return
        self._log.info(f"calibration {kept.number} of {self._history.folder} is in force")
        self._put(kept, _saved_run(kept))

    def replace(self, calibration: Calibration, run_id: str) -> str:
        """Save a calibration and put it into force.

        Returns
        -------
        str
            What to add to the report of that if it could not be saved; else empty.
        """
        number, problem = 0, ""
        try:
            number = self._history.add(calibration)
        except InputError as error:
            problem = f", but not saved: {error}"
            self._log.error(f"run {run_id} is in force{problem}")
        self._put(Kept(number, calibration), run_id)
        return problem

    def rollback(self) -> str:
        """Put the calibration before the one in force into force; return what was done.

        Raises
        ------
        InputError
            There is none that can be used; nothing has changed then.
        """
        if self._kept is None:
            raise InputError("there is no calibration in force to go back from")
        earlier = self._history.before(self._kept.number)
        self._require_usable(earlier)
        self._history.withdraw_after(earlier.number)
        self._put(earlier, _saved_run(earlier))
        return f"calibration {earlier.number} is in force again"

    def export(self, path: str) -> Path:
        """Write the calibration in force to a file below the results folder.

        Raises
        ------
        InputError
            There is none yet, or the path cannot be written to.
        """
        if self._kept is None:
            raise InputError("there is no calibration to save yet")
        return self._history.export(self._kept.calibration, path)

    def _require_usable(self, kept: Kept) -> None:
        """Demand a calibration of our cameras, with clocks that run forwards."""
        corrections_of(kept.calibration)
        if others := [c.name for c in kept.calibration.cameras if c.name not in self._cameras]:
            raise InputError(
                f"calibration {kept.number} of {self._history.folder} has the cameras "
                f"{', '.join(others)}, which are not configured"
            )

    def _put(self, kept: Kept, run_id: str) -> None:
        self._kept, self._run_id = kept, run_id
        self._clocks = corrections_of(kept.calibration)
        self._publishers.publish(kept.calibration, self._message(kept.calibration, run_id))


def _saved_run(kept: Kept) -> str:
    return f"saved-{kept.number:06d}"
