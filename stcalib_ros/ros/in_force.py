"""The calibration in force: published, kept on disk, and found there after a restart."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from rclpy.serialization import serialize_message

from stcalib_ros.core.errors import CalibrationError, InputError, one_line
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.io.exports import export_format
from stcalib_ros.io.history import History, Kept
from stcalib_ros.io.results import read_usable_result
from stcalib_ros.io.stamps import ClockCorrection, corrections_of
from stcalib_ros.ros.limits import MAX_LINE, MIN_CAMERAS, SAVE_AGAIN_S
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
    clock : callable
        Steady, seconds.
    """

    def __init__(
        self,
        history: History,
        cameras: Iterable[str],
        publishers: Publishers,
        message: Callable[[Calibration, str], Any],
        log: Any,
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._history, self._cameras = history, frozenset(cameras)
        self._publishers, self._message, self._log = publishers, message, log
        self._kept: Kept | None = None
        self._clocks: Mapping[str, ClockCorrection] = {}
        self._run_id = self._problem = ""
        self._shared = False
        self._clock, self._next_s = clock, 0.0

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

    @property
    def problem(self) -> str:
        """Why the calibration in force is not on the disk; empty if it is, or there is none."""
        return self._problem

    def load(self, initial: Path | None = None) -> None:
        """Put the newest saved calibration that can be used into force, if there is one.

        Parameters
        ----------
        initial : Path, optional
            Result file that is put into force instead, and saved, if its data are from later.

        Raises
        ------
        InputError
            `initial` cannot be used.
        """
        given = None if initial is None else self._initial(initial)
        self._load_saved()
        if initial is None or given is None:
            return
        if self.calibration is not None and given.window_s[1] <= self.calibration.window_s[1]:
            self._log.info(
                f"{initial} is not put into force: the saved calibration is from later data"
            )
            return
        problem = self.replace(given, f"file-{initial.stem}")
        self._log.info(f"{initial} is in force{problem}")

    def _initial(self, path: Path) -> Calibration:
        try:
            calibration = read_usable_result(path)
            self._require_usable(calibration)
        except (InputError, CalibrationError) as error:
            where = "" if str(path) in str(error) else f"{path}: "
            raise InputError(f"initial_calibration: {where}{error}") from error
        return calibration

    def _load_saved(self) -> None:
        try:
            self._history.sweep()
            self._claim()
            kept, skipped = self._history.latest(self._require_usable)
        except InputError as error:
            self._log.error(f"no saved calibration is used: {one_line(str(error), MAX_LINE)}")
            return
        for problem in skipped:
            self._log.error(f"a saved calibration is not used: {one_line(problem, MAX_LINE)}")
        if kept is None:
            return
        instead = ", the newest that can be used," if skipped else ""
        self._log.info(f"calibration {kept.number} of {self._history.folder}{instead} is in force")
        self._put(kept, _saved_run(kept))

    def replace(self, calibration: Calibration, run_id: str) -> str:
        """Save a calibration and put it into force.

        Returns
        -------
        str
            What to add to the report of that if it could not be saved; else empty.
        """
        number = self._saved(calibration)
        problem = f", but not saved: {self._problem}" if self._problem else ""
        if problem:
            self._log.error(f"run {run_id} is in force{problem}; saving is tried again")
        self._put(Kept(number, calibration), run_id)
        return problem

    def save_again(self) -> None:
        """Save the calibration in force, if it could not be saved when it came into force."""
        if not self._problem or self._kept is None or self._clock() < self._next_s:
            return
        number = self._saved(self._kept.calibration)
        if not self._problem:
            self._kept = replace(self._kept, number=number)
            self._log.info(f"run {self._run_id} is saved now, as calibration {number}")

    def rollback(self) -> str:
        """Put the calibration before the one in force into force; return what was done.

        Raises
        ------
        InputError
            There is none that can be used; nothing has changed then.
        """
        if self._kept is None:
            raise InputError("there is no calibration in force to go back from")
        earlier, skipped = self._history.before(self._kept.number, self._require_usable)
        self._history.withdraw_after(earlier.number)
        self._problem = ""
        self._put(earlier, _saved_run(earlier))
        instead = "".join(f"; not used: {problem}" for problem in skipped)
        return f"calibration {earlier.number} is in force again{instead}"

    def export(self, path: str, form: str) -> Path:
        """Write the calibration in force below the results folder.

        Parameters
        ----------
        path : str
        form : str
            Name of one of `EXPORTS`.

        Raises
        ------
        InputError
            There is none yet, the format is unknown, or the path cannot be written to.
        """
        known = export_format(form)
        if self._kept is None:
            raise InputError("there is no calibration to save yet")
        return self._history.export(self._kept.calibration, path, known)

    def _saved(self, calibration: Calibration) -> int:
        """Save; returns the number, or 0 and notes the problem."""
        number, self._problem = 0, ""
        try:
            number = self._history.add(calibration)
            self._claim()
        except InputError as error:
            self._problem = one_line(str(error), MAX_LINE)
            self._next_s = self._clock() + SAVE_AGAIN_S
        return number

    def _claim(self) -> None:
        """Warn, once, of another node that saves to the same folder."""
        if not self._history.claim() and not self._shared:
            self._shared = True
            self._log.warning(
                f"{self._history.folder}: another process keeps its calibrations there, too; "
                "after a restart, either may start with those of the other: give one of them "
                "another results_folder"
            )

    def _require_usable(self, calibration: Calibration) -> None:
        """Demand a calibration of our cameras that is to be used, with clocks that run forwards."""
        corrections_of(calibration)
        if calibration.status is not Status.OK:
            raise InputError(f"its status is {calibration.status.name}")
        if len(calibration.cameras) < MIN_CAMERAS:
            raise InputError(f"it has {len(calibration.cameras)} cameras")
        if others := [c.name for c in calibration.cameras if c.name not in self._cameras]:
            raise InputError(f"it has the cameras {', '.join(others)}, which are not configured")
        try:
            serialize_message(self._message(calibration, ""))
        except (SystemError, TypeError, ValueError, OverflowError) as error:
            raise InputError(f"no message can hold it: {error}") from error

    def _put(self, kept: Kept, run_id: str) -> None:
        self._kept, self._run_id = kept, run_id
        self._clocks = corrections_of(kept.calibration)
        self._publishers.publish(kept.calibration, self._message(kept.calibration, run_id))


def _saved_run(kept: Kept) -> str:
    return f"saved-{kept.number:06d}"
