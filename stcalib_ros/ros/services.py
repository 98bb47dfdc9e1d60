"""What others can ask of the live node: services and an action."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from std_srvs.srv import Trigger

from stcalib_ros.action import Calibrate
from stcalib_ros.core.errors import InputError, one_line
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.io.exports.plain import STCALIB
from stcalib_ros.ros.limits import MAX_LINE
from stcalib_ros.ros.worker import Step, failure
from stcalib_ros.srv import Recalibrate, SaveCalibration

Feedback = Callable[[Step], None]


@dataclass(slots=True, eq=False)
class Run:
    """A run in progress.

    Attributes
    ----------
    run_id : str
    result : Future
        Gives the ``CalibrationResult``.
    feedback : callable or None
        Called with every step.
    """

    run_id: str
    result: Future
    feedback: Feedback | None


class ServedCalibrator(Protocol):
    """What the services ask of the node."""

    def start(
        self,
        *,
        cameras: Iterable[str] = (),
        start_s: float = -math.inf,
        end_s: float = math.inf,
        feedback: Feedback | None = None,
    ) -> Run | Calibration:
        """Start a run on request, or return a failure that says why not."""

    def refusal(
        self,
        *,
        cameras: Iterable[str] = (),
        start_s: float = -math.inf,
        end_s: float = math.inf,
    ) -> Calibration | None:
        """Return a failure that says why a run cannot start, or None if it can."""

    def cancel(self) -> None:
        """Cancel the run in progress."""

    def rollback(self) -> str:
        """Put the calibration before the one in force into force; return what was done."""

    def save(self, path: str, form: str) -> Path:
        """Write the calibration in force below the results folder, in one of `EXPORTS`."""

    def message(self, calibration: Calibration, run_id: str) -> Any:
        """Return the ``CalibrationResult`` of a calibration."""


class Services:
    """Answers requests; while a run is in progress, another one is refused at once.

    Those that wait for the end of a run are coroutines in a callback group of their own, so that
    nothing else waits with them.

    Parameters
    ----------
    node : rclpy.node.Node
    calibrator : ServedCalibrator
    """

    def __init__(self, node: Any, calibrator: ServedCalibrator) -> None:
        self._calibrator, self._log = calibrator, node.get_logger()
        self._running: Any = None
        long = ReentrantCallbackGroup()
        node.create_service(Recalibrate, "~/recalibrate", self._recalibrate, callback_group=long)
        node.create_service(Trigger, "~/recalibrate_now", self._recalibrate_now)
        node.create_service(SaveCalibration, "~/save", self._save)
        node.create_service(Trigger, "~/rollback", self._rollback)
        self._action = ActionServer(
            node,
            Calibrate,
            "~/calibrate",
            self._calibrate,
            goal_callback=self._may_start,
            cancel_callback=self._cancel,
            callback_group=long,
        )

    def destroy(self) -> None:
        """Release the action server, which its node does not."""
        self._action.destroy()

    async def _recalibrate(self, request: Any, response: Any) -> Any:
        run = self._calibrator.start(**_wanted(request))
        if isinstance(run, Calibration):
            response.result = self._calibrator.message(run, "")
            return response
        response.accepted, response.run_id = True, run.run_id
        if request.wait:
            response.result = await run.result
        return response

    def _recalibrate_now(self, _request: Any, response: Any) -> Any:
        run = self._calibrator.start()
        response.success = not isinstance(run, Calibration)
        response.message = (
            run.message if isinstance(run, Calibration) else f"run {run.run_id} has started"
        )
        return response

    def _save(self, request: Any, response: Any) -> Any:
        try:
            saved = self._calibrator.save(request.path, request.format or STCALIB.name)
            response.message = f"written to {saved}"
            response.success = True
        except InputError as error:
            response.message = one_line(str(error), MAX_LINE)
        return response

    def _rollback(self, _request: Any, response: Any) -> Any:
        try:
            response.message = one_line(self._calibrator.rollback(), MAX_LINE)
            response.success = True
        except InputError as error:
            response.message = one_line(str(error), MAX_LINE)
        return response

    def _may_start(self, request: Any) -> Any:
        """Reject a goal that cannot start; the log says why, since a rejection cannot."""
        refused = self._calibrator.refusal(**_wanted(request))
        if refused is None:
            return GoalResponse.ACCEPT
        self._log.warning(f"~/calibrate: goal rejected: {refused.message}")
        return GoalResponse.REJECT

    async def _calibrate(self, goal: Any) -> Any:
        def publish(step: Step) -> None:
            goal.publish_feedback(
                Calibrate.Feedback(
                    stage=step.stage, progress=step.fraction, reprojection_rms_px=step.rms_px
                )
            )

        if goal.is_cancel_requested:
            goal.canceled()
            never = failure(Status.CANCELLED, "cancelled before the run started")
            return Calibrate.Result(result=self._calibrator.message(never, ""))
        run = self._calibrator.start(**_wanted(goal.request), feedback=publish)
        if isinstance(run, Calibration):
            goal.abort()
            return Calibrate.Result(result=self._calibrator.message(run, ""))
        self._running = goal
        result = await run.result
        self._running = None
        if result.status == int(Status.OK):
            goal.succeed()
        elif goal.is_cancel_requested and result.status == int(Status.CANCELLED):
            goal.canceled()
        else:
            goal.abort()
        return Calibrate.Result(result=result)

    def _cancel(self, goal: Any) -> Any:
        """Accept; a goal whose run is not in progress has none to cancel."""
        if self._running is not None and goal == self._running:
            self._calibrator.cancel()
        return CancelResponse.ACCEPT


def _wanted(request: Any) -> dict[str, Any]:
    """Return what a request or a goal asks for, as arguments of `ServedCalibrator.start`."""
    return {
        "cameras": request.cameras,
        "start_s": _bound(request.start, -math.inf),
        "end_s": _bound(request.end, math.inf),
    }


def _bound(stamp: Any, none: float) -> float:
    """Seconds of a time message; `none` for zero, which means no bound."""
    seconds = stamp.sec + stamp.nanosec * 1e-9
    return float(seconds) if seconds else none
