"""One calibration at a time, followed by a thread of its own; knows no ROS."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from stcalib_ros.core.errors import Cancelled, InputError
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.rejection import Rejection, RejectionReason
from stcalib_ros.core.options import Options
from stcalib_ros.io.assemble import CameraImages, Warn
from stcalib_ros.ros.solver import SolverError, calibrate_in_subprocess


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """What to calibrate from.

    Attributes
    ----------
    run_id : str
    cameras : sequence of CameraImages
    options : Options
    requested : bool
        A person asked for it.
    wrong : str
        Why the calibration in force does not hold any more; empty if it holds.
    """

    run_id: str
    cameras: Sequence[CameraImages]
    options: Options
    requested: bool
    wrong: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What came of a job.

    Attributes
    ----------
    job : Job
        Without its images.
    calibration : Calibration
        Without cameras if the job failed; its message says why.
    took_s : float
        Wall time of the job.
    ended_s : float
        When it ended, Unix seconds by this machine's clock.
    """

    job: Job
    calibration: Calibration
    took_s: float
    ended_s: float


@dataclass(frozen=True, slots=True)
class Step:
    """Where a job stands.

    Attributes
    ----------
    run_id : str
    stage : str
    fraction : float
        Fraction of the stage that is done.
    rms_px : float
        Reprojection error so far; NaN before the first adjustment.
    """

    run_id: str
    stage: str
    fraction: float
    rms_px: float = math.nan


_REASONS = {
    Status.INSUFFICIENT_DATA: RejectionReason.INPUT_UNUSABLE,
    Status.NOT_CONVERGED: RejectionReason.SOLVER_FAILED,
    Status.CANCELLED: RejectionReason.CANCELLED,
}
"""Codes of runs that did not come to an end."""


def failure(status: Status, message: str) -> Calibration:
    """Calibration that holds nothing but the reason why."""
    return Calibration(
        status=status,
        message=message,
        reference="",
        metric=False,
        epoch_s=math.nan,
        window_s=(math.nan, math.nan),
        cameras=(),
        uncalibrated=(),
        persons=(),
        pairs=(),
        reprojection_rms_px=math.nan,
        n_observations=0,
        n_inliers=0,
        rejections=(Rejection(_REASONS[status], detail=message),),
    )


class Worker:
    """Runs jobs, one at a time.

    Parameters
    ----------
    wake : callable
        Called from the worker's thread when `step` has changed or `collect` has something.
    warn : callable
        Called from the worker's thread with warnings about the data.
    """

    def __init__(self, wake: Callable[[], None], warn: Warn) -> None:
        self._wake, self._warn = wake, warn
        self._lock = threading.Lock()
        self._cancel = threading.Event()
        self._thread: threading.Thread | None = None
        self._step: Step | None = None
        self._outcome: Outcome | None = None

    @property
    def step(self) -> Step | None:
        """Where the job stands; None if there is none. A job ends when it is collected."""
        with self._lock:
            return self._step

    def start(self, job: Job) -> bool:
        """Start a job; false, and nothing happens, while there is one."""
        with self._lock:
            if self._step is not None:
                return False
            self._step = Step(job.run_id, "assembly", 0.0)
        self._cancel.clear()
        # A daemon, so that a solver in the middle of a long step does not keep the process alive.
        # The list is emptied by the thread: a job's images are kept no longer than they are needed.
        self._thread = threading.Thread(target=self._run, args=([job],), daemon=True)
        self._thread.start()
        return True

    def collect(self) -> Outcome | None:
        """Outcome of a job that has ended, once; the next may start then."""
        with self._lock:
            outcome, self._outcome = self._outcome, None
            if outcome is not None:
                self._step = None
        return outcome

    def cancel(self) -> None:
        """Ask the job to end; its outcome is ``CANCELLED`` then."""
        self._cancel.set()

    def stop(self, timeout_s: float) -> bool:
        """Cancel and wait; false if the job still runs after the timeout."""
        self.cancel()
        if self._thread is not None:
            self._thread.join(timeout_s)
        return self._thread is None or not self._thread.is_alive()

    def _run(self, waiting: list[Job]) -> None:
        job = waiting.pop()
        begin, cameras = time.monotonic(), list(job.cameras)
        job = replace(job, cameras=())
        calibration = self._calibration(job, cameras)
        outcome = Outcome(job, calibration, time.monotonic() - begin, time.time())
        with self._lock:
            self._outcome = outcome
        self._wake()

    def _calibration(self, job: Job, cameras: list[CameraImages]) -> Calibration:
        rms_px = math.nan

        def adjusted(value: float) -> None:
            nonlocal rms_px
            rms_px = value

        def progress(stage: str, fraction: float) -> None:
            self._note(Step(job.run_id, stage, fraction, rms_px))

        try:
            return calibrate_in_subprocess(
                cameras,
                job.options,
                cancelled=self._cancel.is_set,
                warn=self._warn,
                progress=progress,
                adjusted=adjusted,
            )
        except Cancelled as error:
            return failure(Status.CANCELLED, str(error))
        except InputError as error:
            return failure(Status.INSUFFICIENT_DATA, str(error))
        except SolverError as error:
            return failure(Status.NOT_CONVERGED, str(error))
        except Exception as error:  # the node goes on, whatever the solver stumbles over
            return failure(Status.NOT_CONVERGED, f"{type(error).__name__}: {error}")

    def _note(self, step: Step) -> None:
        with self._lock:
            self._step = step
        self._wake()
