"""``ros2 run stcalib_ros calibrator``: calibrates from live topics while it is left running."""

from __future__ import annotations

import gc
import math
import os
import sys
import uuid
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.task import Future

from stcalib_ros.cli import run_command
from stcalib_ros.core.errors import InputError, one_line
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.monitoring.alarms import Verdict
from stcalib_ros.core.monitoring.replacement import should_replace
from stcalib_ros.io.history import History
from stcalib_ros.msg import CalibrationResult
from stcalib_ros.ros.buffer_warnings import BufferWarnings
from stcalib_ros.ros.buffers import Buffers
from stcalib_ros.ros.camera_buffer import Counts
from stcalib_ros.ros.convert import calibration_result, time_message
from stcalib_ros.ros.diagnostics import (
    SolverState,
    camera_status,
    changed_line,
    complaints,
    load_status,
    solver_status,
    starvation,
)
from stcalib_ros.ros.driver_lenses import OFF, DriverLenses
from stcalib_ros.ros.in_force import InForce
from stcalib_ros.ros.intake import Intake
from stcalib_ros.ros.limits import (
    CHECK_S,
    MAX_LINE,
    STARVED_S,
    STOP_S,
)
from stcalib_ros.ros.load import Meter
from stcalib_ros.ros.parameter_specs import calibrator_help, help_asked
from stcalib_ros.ros.parameters import Settings, declare, settings_from
from stcalib_ros.ros.publishers import Publishers
from stcalib_ros.ros.readiness import Trigger, moving_since, ready_cameras
from stcalib_ros.ros.requests import Wanted
from stcalib_ros.ros.running import running_node, spin_until
from stcalib_ros.ros.services import Feedback, Run, Services
from stcalib_ros.ros.subscriptions import Subscriptions
from stcalib_ros.ros.throttle import Throttle
from stcalib_ros.ros.views import Views
from stcalib_ros.ros.watcher import Watcher
from stcalib_ros.ros.worker import Job, Outcome, Worker, failure


class Calibrator:
    """The node: topics in, a worker, topics out.

    All methods run in the executor's thread.

    Parameters
    ----------
    node : rclpy.node.Node

    Raises
    ------
    InputError
        A parameter cannot be used.
    """

    def __init__(self, node: Any) -> None:
        self.node, self.log = node, node.get_logger()
        self._values = declare(node)
        self.settings = settings_from(self._values, node_name=node.get_fully_qualified_name())
        self._throttle = Throttle(self.log.warning)
        self._throttle.not_before("starved", STARVED_S)
        self._warnings = BufferWarnings(self._throttle)
        self.buffers = Buffers(self.settings.cameras, self.settings.limits, self._warnings)
        self.buffers.set_default(LensKnowledge(self.settings.options.intrinsics))
        self.run: Run | None = None
        self._solver = SolverState()
        self._trigger, self._meter = Trigger(), Meter()
        self._guard = node.create_guard_condition(self._meter.timed(self._progressed))
        self.worker = Worker(self._guard.trigger, self.log.warning)
        self.watcher = Watcher(self.log.warning)
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._intake = Intake(self.settings.cameras, self.buffers, self._meter)
        self._lost = self._intake.lost()
        self._subscriptions = Subscriptions(node, self.settings, self._intake)
        self.services = Services(node, self)
        self._drivers = DriverLenses(node, self.settings.set_camera_info)
        publishers = Publishers(node, self.settings)
        self._views = Views(node, self.settings, self.buffers, publishers)
        self.in_force = InForce(
            History(self.settings.results_folder, keep=self.settings.keep_results),
            [camera.name for camera in self.settings.cameras],
            publishers,
            self.message,
            self.log,
        )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(CHECK_S, self._meter.timed(self._every_second), clock=steady)
        node.add_on_set_parameters_callback(self._validate_parameters)
        node.add_post_set_parameters_callback(self._apply_parameters)
        self.in_force.load(self.settings.initial_calibration)
        self._begin()

    def start(
        self,
        *,
        cameras: Iterable[str] = (),
        start_s: float = -math.inf,
        end_s: float = math.inf,
        requested: bool = True,
        feedback: Feedback | None = None,
    ) -> Run | Calibration:
        """Start a run, or return a failure that says why not.

        Parameters
        ----------
        cameras : iterable of str
            Cameras to use; none: all.
        start_s, end_s : float
            First and last stamp to use, by the reference clock. Without the first, nothing is used
            from before the last change of a camera that the watch has noticed.
        requested : bool
            A person asked for it.
        feedback : callable, optional
            Called with every step.
        """
        wanted = self._wanted(cameras, start_s, end_s)
        if (refused := self._refused(wanted)) is not None:
            return refused
        run = Run(uuid.uuid4().hex[:12], Future(), feedback)
        wrong = self.watcher.complaint if wanted.start_s >= self.watcher.changed_s else ""
        images, options = wanted.images, self.settings.options
        self.worker.start(Job(run.run_id, images, options, requested, wrong))
        self.run = run
        self.log.info(f"run {run.run_id} starts with {', '.join(c.name for c in images)}")
        self._publish_diagnostics(wanted.counts)
        return run

    def refusal(
        self,
        *,
        cameras: Iterable[str] = (),
        start_s: float = -math.inf,
        end_s: float = math.inf,
    ) -> Calibration | None:
        """Return a failure that says why a run cannot start, or None; see `start`."""
        return self._refused(self._wanted(cameras, start_s, end_s))

    def _wanted(self, cameras: Iterable[str], start_s: float, end_s: float) -> Wanted:
        """Collect what a run would be made of."""
        names = tuple(cameras)
        if start_s == -math.inf:
            start_s = self.watcher.changed_s
        clocks = self.in_force.clocks
        images = self.buffers.snapshot(names, start_s=start_s, end_s=end_s, clocks=clocks)
        return Wanted(names, start_s, images, self.buffers.counts())

    def _refused(self, wanted: Wanted) -> Calibration | None:
        if self.run is not None:
            return failure(Status.CANCELLED, f"not started: run {self.run.run_id} is under way")
        if self.worker.step is not None:
            return failure(Status.CANCELLED, "not started: the last run has not ended yet")
        return wanted.refusal([camera.name for camera in self.settings.cameras])

    def cancel(self) -> None:
        """Cancel the run in progress."""
        self.worker.cancel()

    def rollback(self) -> str:
        """Put the calibration before the one in force into force; return what was done.

        Raises
        ------
        InputError
            There is none that can be used; nothing has changed then.
        """
        done = self.in_force.rollback()
        self._begin()
        self._hand_over()
        return done

    def save(self, path: str, form: str) -> Path:
        """Write the calibration in force below the results folder, see `InForce.export`."""
        return self.in_force.export(path, form)

    def message(self, calibration: Calibration, run_id: str) -> CalibrationResult:
        """Message of a calibration, stamped with the end of its data; of a failure, with now."""
        end_s = calibration.window_s[1]
        now = self.node.get_clock().now().to_msg()
        return calibration_result(
            calibration,
            run_id=run_id,
            stamp=time_message(end_s) if math.isfinite(end_s) else now,
            frame_rates={n: counts.rate_hz for n, counts in self.buffers.counts().items()},
        )

    def _begin(self) -> None:
        """Take note of another calibration in force, if there is one."""
        if self.in_force.calibration is not None:
            self._trigger.settle(True)
        self._solver = replace(self._solver, in_force=self.in_force.run_id)
        self._views.begin(self.in_force.calibration)
        self._begin_watch()

    def _begin_watch(self) -> None:
        self.watcher.begin(self.in_force.calibration if self.settings.watch else None)

    def _hand_over(self) -> None:
        """Offer the lenses of the calibration that has just come into force to their drivers."""
        if self.in_force.calibration is not None:
            found = self.message(self.in_force.calibration, self.in_force.run_id).intrinsics
            self._drivers.offer(found, self.buffers.driver_images())

    def _progressed(self) -> None:
        """Pass on what is new of the worker."""
        step = self.worker.step
        if self.run is not None and self.run.feedback is not None and step is not None:
            self.run.feedback(step)
        if (outcome := self.worker.collect()) is not None:
            self._conclude(outcome)

    def _conclude(self, outcome: Outcome) -> None:
        run, self.run = self.run, None
        try:
            self._take(outcome)
        finally:
            if run is not None:
                run.result.set_result(self.message(outcome.calibration, outcome.job.run_id))

    def _take(self, outcome: Outcome) -> None:
        """Put the calibration of a run into force, if it is better, and report."""
        job, calibration = outcome.job, outcome.calibration
        taken, reason = should_replace(
            calibration, self.in_force.calibration, requested=job.requested, wrong=job.wrong
        )
        verdict = f"not taken: {reason}"
        if taken:
            problem = self.in_force.replace(calibration, job.run_id)
            self._begin()
            self._hand_over()
            verdict = f"{calibration.message}; in force, since {reason}{problem}"
        self.log.info(f"run {job.run_id} has ended: {verdict}")
        self._solver = replace(
            self._solver,
            last_run=job.run_id,
            last_status=calibration.status.name,
            last_message=verdict,
            last_reasons=calibration.reasons,
            last_took_s=outcome.took_s,
            last_ended_s=outcome.ended_s,
        )
        self._publish_diagnostics(self.buffers.counts())

    def _every_second(self) -> None:
        self._subscriptions.add_latched()
        self._subscriptions.follow_people()
        self.in_force.save_again()
        counts = self.buffers.counts()
        self._warnings.settle()
        self._watch(counts)
        self._views.refresh(self.settings, counts, self.watcher.verdicts)
        lacks = self._publish_diagnostics(counts)
        for subject, line, every_s in complaints(lacks, counts):
            self._throttle(subject, line, every_s=every_s)
        wanted = self.settings.auto_calibrate or (
            self.settings.auto_recalibrate and self.watcher.complaint
        )
        if wanted and self.run is None:
            self._consider()

    def _watch(self, counts: Mapping[str, Counts]) -> None:
        """Check what arrives against the calibration in force and report; not during a run."""
        if self.run is not None:
            return
        for verdict in self.watcher.news(self.settings.thresholds):
            self._report(verdict)
        self.watcher.look(
            self.buffers.snapshot,
            {name: count.age_s for name, count in counts.items()},
            min_score=self.settings.options.min_score,
        )

    def _report(self, verdict: Verdict) -> None:
        if not verdict.state.alarm:
            self.log.info(verdict.sentence())
        elif not verdict.state.changed:
            self.log.warning(verdict.sentence())
        else:
            self.log.error(changed_line(verdict, again=self.settings.auto_recalibrate))
            if self.settings.auto_recalibrate:
                self._trigger = Trigger()

    def _consider(self) -> None:
        """Calibrate unasked, if enough was seen since something happened."""
        moving = moving_since(self.buffers.moving(), self.watcher.changed_s, self.in_force.clocks)
        slack_s = 2.0 * self.settings.options.offset_range_s
        ready = frozenset(
            ready_cameras(moving, min_motion_s=self.settings.min_motion_s, slack_s=slack_s)
        )
        now_s = self.buffers.newest_s()
        window_s = self.settings.limits.window_s
        if self._trigger.due(ready, now_s, period_s=self.settings.period_s, window_s=window_s):
            self._trigger.tried(ready, now_s)
            self.start(requested=False)

    def _publish_diagnostics(self, counts: Mapping[str, Counts]) -> dict[str, str]:
        """Publish the state of everything; return what each camera lacks."""
        prefix = self.node.get_fully_qualified_name().strip("/")
        verdicts, drivers = self.watcher.verdicts, self._drivers.states()
        cameras = {camera.name: camera for camera in self.settings.cameras}
        lacks = {n: starvation(c, counts[n], self.node) for n, c in cameras.items()}
        lost = self._intake.lost()
        newly_lost, self._lost = sum(lost.values()) > sum(self._lost.values()), lost
        array = DiagnosticArray(
            status=[
                solver_status(
                    prefix,
                    replace(self._solver, step=self.worker.step, unsaved=self.in_force.problem),
                ),
                load_status(prefix, self._meter.load(), lost, newly_lost=newly_lost),
                *(
                    camera_status(
                        *(prefix, c, counts[n], lacks[n], verdicts.get(n)),
                        *(drivers.get(n, OFF), self._views.coverage.get(n)),
                    )
                    for n, c in cameras.items()
                ),
            ]
        )
        array.header.stamp = self.node.get_clock().now().to_msg()
        self._diagnostics.publish(array)
        return lacks

    def _validate_parameters(self, changes: Iterable[Any]) -> SetParametersResult:
        """Say whether parameters can be changed; those that are read-only never come here."""
        try:
            self._settings_after(changes)
        except InputError as error:
            return SetParametersResult(successful=False, reason=one_line(str(error), MAX_LINE))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, changes: Iterable[Any]) -> None:
        """Act on parameters that have changed, after everybody has agreed."""
        before = self.settings
        self._values, self.settings = self._settings_after(changes)
        if self.settings.watch != before.watch:
            self._begin_watch()
        self.buffers.set_limits(self.settings.limits)
        self.buffers.set_default(LensKnowledge(self.settings.options.intrinsics))

    def _settings_after(self, changes: Iterable[Any]) -> tuple[dict[str, Any], Settings]:
        values = self._values | {p.name: p.value for p in changes if p.name in self._values}
        return values, settings_from(values, node_name=self.node.get_fully_qualified_name())


def main() -> int:
    """Run the node until SIGINT or SIGTERM.

    Returns
    -------
    int
        Exit status: 0 stopped, or helped; 2 unusable parameters.
    """
    if help_asked(sys.argv[1:]):
        print(calibrator_help())
        return 0
    return run_command("calibrator", _run)


def _run() -> None:
    with running_node("calibrator") as (node, stop):
        calibrator = Calibrator(node)
        # What is there now stays: the collector would look through it over and over, 60 ms each.
        gc.collect()
        gc.freeze()
        spin_until(stop, node)
        if not calibrator.worker.stop(STOP_S):
            # The solver is in the middle of a long step. Nothing is being written: leave it.
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(0)
        calibrator.services.destroy()
