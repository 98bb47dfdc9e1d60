"""``ros2 run stcalib_ros calibrator``: calibrates from live topics while it is left running."""

from __future__ import annotations

import gc
import math
import os
import sys
import time
import uuid
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from sensor_msgs.msg import CameraInfo

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.rejection import Rejection
from stcalib_ros.core.monitoring.alarms import Verdict
from stcalib_ros.core.monitoring.replacement import should_replace
from stcalib_ros.io.history import History, Kept
from stcalib_ros.msg import CalibrationResult, PersonPose3DArray
from stcalib_ros.ros.buffers import Buffers, Counts
from stcalib_ros.ros.convert import calibration_result, time_message
from stcalib_ros.ros.diagnostics import (
    STARVED_S,
    SolverState,
    camera_status,
    load_status,
    solver_status,
    starvation,
)
from stcalib_ros.ros.intake import Intake, Take
from stcalib_ros.ros.load import Meter
from stcalib_ros.ros.parameters import declare, settings_from
from stcalib_ros.ros.publishers import Publishers, latched
from stcalib_ros.ros.readiness import Trigger, ready_cameras
from stcalib_ros.ros.running import spin_until, stop_on_signals
from stcalib_ros.ros.services import Services
from stcalib_ros.ros.watcher import Watcher
from stcalib_ros.ros.worker import Job, Outcome, Step, Worker, failure

_REPEAT_S = 5.0
_REPEAT_STARVED_S = 30.0
_STOP_S = 1.0

Feedback = Callable[[Step], None]


@dataclass(slots=True, eq=False)
class Run:
    """A run under way: its name, its result to come, and whom to tell of its progress."""

    run_id: str
    result: Future
    feedback: Feedback | None


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
        self._said: dict[str, float] = {"starved": time.monotonic() + STARVED_S - _REPEAT_STARVED_S}
        self.buffers = Buffers(self.settings.cameras, self.settings.limits, self._say)
        self.history = History(self.settings.results_folder, keep=self.settings.keep_results)
        self.in_force: Kept | None = None
        self._in_force_run = self._last_run = self._last_status = self._last_message = ""
        self._last_reasons: tuple[Rejection, ...] = ()
        self._last_took_s = self._last_ended_s = math.nan
        self.run: Run | None = None
        self._trigger, self._meter = Trigger(), Meter()
        self._guard = node.create_guard_condition(self._meter.timed(self._progressed))
        self.worker = Worker(self._guard.trigger, self.log.warning)
        self.watcher = Watcher(self.log.warning)
        self._publishers = Publishers(node, self.settings)
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._intake = Intake(self.settings.cameras, self.buffers, self._meter)
        self._lost = self._intake.lost()
        self._latched: set[str] = set()
        self._subscribe()
        self.services = Services(self)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(1.0, self._meter.timed(self._every_second), clock=steady)
        node.add_on_set_parameters_callback(self._change_parameters)
        self._load()

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
            Told of the progress.
        """
        names = tuple(cameras)
        if self.run is not None:
            return failure(Status.CANCELLED, f"not started: run {self.run.run_id} is under way")
        known = [camera.name for camera in self.settings.cameras]
        if unknown := [name for name in names if name not in known]:
            return failure(
                Status.INSUFFICIENT_DATA,
                f"not started: no camera {', '.join(unknown)}; there are {', '.join(known)}",
            )
        if start_s == -math.inf:
            start_s = self.watcher.changed_s
        images = self.buffers.snapshot(
            names, start_s=start_s, end_s=end_s, offsets_s=self._offsets()
        )
        if len(images) < 2:
            there = ", ".join(c.name for c in images) or "none"
            return failure(
                Status.INSUFFICIENT_DATA,
                "not started: at least two cameras with poses and CameraInfo are needed, there "
                f"is {there}; /diagnostics tells what the others wait for",
            )
        run = Run(uuid.uuid4().hex[:12], Future(), feedback)
        self.run = run
        self.log.info(f"run {run.run_id} starts with {', '.join(c.name for c in images)}")
        wrong = self.watcher.complaint if start_s >= self.watcher.changed_s else ""
        self.worker.start(Job(run.run_id, images, self.settings.options, requested, wrong))
        self._publish_diagnostics()
        return run

    def rollback(self) -> str:
        """Put the calibration before the one in force into force; returns what was done.

        Raises
        ------
        InputError
            There is none that can be used; nothing has changed then.
        """
        if self.in_force is None:
            raise InputError("there is no calibration in force to go back from")
        earlier = self.history.before(self.in_force.number)
        self._require_own_cameras(earlier)
        self.history.withdraw_after(earlier.number)
        self._put_in_force(earlier, _saved_run(earlier))
        return f"calibration {earlier.number} is in force again"

    def message(self, calibration: Calibration, run_id: str) -> CalibrationResult:
        """Message of a calibration, stamped with the end of its data; of a failure, with now."""
        end_s = calibration.window_s[1]
        now = self.node.get_clock().now().to_msg()
        return calibration_result(
            calibration,
            run_id=run_id,
            stamp=time_message(end_s) if math.isfinite(end_s) else now,
            frame_rates=self._rates(),
        )

    def _subscribe(self) -> None:
        """Listen to every camera, as drivers send: best effort, volatile."""
        qos = QoSProfile(depth=self.settings.queue_depth, reliability=ReliabilityPolicy.BEST_EFFORT)
        for camera in self.settings.cameras:
            take, info = self._intake.poses_of(camera), self._intake.info_of(camera)
            self._listen(PersonPose3DArray, camera.pose_topic, take, qos)
            self._listen(CameraInfo, camera.info_topic, info, qos)

    def _subscribe_to_latched(self) -> None:
        """Listen once more where CameraInfo is latched.

        Some send it once and latch it: only a transient local subscription gets what was sent
        before it was there, and only a volatile one what drivers usually send; no QoS receives
        both. The second one is made when somebody offers what it asks for: to others it would be
        incompatible, and each of them would warn of it. A driver that latches and repeats is heard
        twice, which changes nothing: a lens that is known is no news.
        """
        for camera in self.settings.cameras:
            topic = self.node.resolve_topic_name(camera.info_topic)
            if camera.name not in self._latched and any(
                offered.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
                and offered.qos_profile.reliability == ReliabilityPolicy.RELIABLE
                for offered in self.node.get_publishers_info_by_topic(topic)
            ):
                self._latched.add(camera.name)
                take = self._intake.info_of(camera)
                self._listen(CameraInfo, camera.info_topic, take, latched())

    def _listen(self, kind: Any, topic: str, take: Take, qos: QoSProfile) -> None:
        """Without the events that rclpy would wait for besides, two per topic: they cost time.

        Nothing is incompatible, and /diagnostics tells of wrong types.
        """
        silent = SubscriptionEventCallbacks(use_default_callbacks=False)
        self.node.create_subscription(kind, topic, take, qos, raw=True, event_callbacks=silent)

    def _load(self) -> None:
        try:
            kept = self.history.latest()
            if kept is None:
                return
            self._require_own_cameras(kept)
        except InputError as error:
            self.log.error(f"the saved calibration is not used: {error}")
            return
        self.log.info(f"calibration {kept.number} of {self.history.folder} is in force")
        self._put_in_force(kept, _saved_run(kept))

    def _require_own_cameras(self, kept: Kept) -> None:
        names = {camera.name for camera in self.settings.cameras}
        if others := [c.name for c in kept.calibration.cameras if c.name not in names]:
            raise InputError(
                f"calibration {kept.number} of {self.history.folder} has the cameras "
                f"{', '.join(others)}, which are not configured"
            )

    def _put_in_force(self, kept: Kept, run_id: str) -> None:
        self.in_force, self._in_force_run = kept, run_id
        self._trigger.settle(True)
        self._begin_watch()
        self._publishers.publish(kept.calibration, self.message(kept.calibration, run_id))

    def _progressed(self) -> None:
        """The worker has something new."""
        step = self.worker.step
        if self.run is not None and self.run.feedback is not None and step is not None:
            self.run.feedback(step)
        if (outcome := self.worker.collect()) is not None:
            self._conclude(outcome)

    def _conclude(self, outcome: Outcome) -> None:
        job, calibration = outcome.job, outcome.calibration
        old = None if self.in_force is None else self.in_force.calibration
        taken, reason = should_replace(calibration, old, requested=job.requested, wrong=job.wrong)
        if taken:
            verdict = f"in force, since {reason}{self._take(calibration, job.run_id)}"
        else:
            verdict = f"not taken: {reason}"
        self._last_reasons = calibration.reasons
        self._last_message = f"{calibration.message}; {verdict}" if taken else verdict
        self.log.info(f"run {job.run_id} has ended: {self._last_message}")
        self._last_run, self._last_status = job.run_id, calibration.status.name
        self._last_took_s, self._last_ended_s = outcome.took_s, outcome.ended_s
        self._publish_diagnostics()
        run, self.run = self.run, None
        if run is not None:
            run.result.set_result(self.message(calibration, job.run_id))

    def _take(self, calibration: Calibration, run_id: str) -> str:
        """Save and put into force; returns what is to be said if only the latter succeeds."""
        number, complaint = 0, ""
        try:
            number = self.history.add(calibration)
        except InputError as error:
            complaint = f", but not saved: {error}"
            self.log.error(f"run {run_id} is in force{complaint}")
        self._put_in_force(Kept(number, calibration), run_id)
        return complaint

    def _every_second(self) -> None:
        self._subscribe_to_latched()
        counts = self.buffers.counts()
        self._watch(counts)
        lacks = self._publish_diagnostics(counts)
        if starved := "; ".join(f"camera {name} {lack}" for name, lack in lacks.items() if lack):
            self._say("starved", starved, every_s=_REPEAT_STARVED_S)
        wanted = self.settings.auto_calibrate or (
            self.settings.auto_recalibrate and self.watcher.complaint
        )
        if wanted and self.run is None:
            self._consider()

    def _begin_watch(self) -> None:
        kept = self.in_force if self.settings.watch else None
        self.watcher.begin(None if kept is None else kept.calibration)

    def _watch(self, counts: Mapping[str, Counts]) -> None:
        """Hold what arrives to the calibration in force, and say what is found; not in a run."""
        if self.run is not None:
            return
        for verdict in self.watcher.news(self.settings.thresholds):
            self._tell(verdict)
        self.watcher.look(
            self.buffers.snapshot,
            {name: count.age_s for name, count in counts.items()},
            min_score=self.settings.options.min_score,
        )

    def _tell(self, verdict: Verdict) -> None:
        if not verdict.state.alarm:
            self.log.info(verdict.sentence())
        elif not verdict.state.changed:
            self.log.warning(verdict.sentence())
        elif self.settings.auto_recalibrate:
            self._trigger = Trigger()
            self.log.error(f"{verdict.sentence()}; calibrating again as soon as people have moved")
        else:
            self.log.error(
                f"{verdict.sentence()}; put it back, or let people walk and call ~/recalibrate_now"
            )

    def _consider(self) -> None:
        """Calibrate unasked, if what was seen, since something happened, is worth it."""
        since_s = self.watcher.changed_s
        moving = {
            name: frozenset(second for second in seconds if second >= since_s)
            for name, seconds in self.buffers.moving().items()
        }
        ready = frozenset(
            ready_cameras(
                moving,
                min_motion_s=self.settings.min_motion_s,
                slack_s=2.0 * self.settings.options.offset_range_s,
            )
        )
        now_s = self.buffers.newest_s()
        window_s = self.settings.limits.window_s
        if self._trigger.due(ready, now_s, period_s=self.settings.period_s, window_s=window_s):
            self._trigger.tried(ready, now_s)
            self.start(requested=False)

    def _publish_diagnostics(self, counts: Mapping[str, Counts] | None = None) -> dict[str, str]:
        counts = counts or self.buffers.counts()
        prefix = self.node.get_fully_qualified_name().strip("/")
        verdicts = self.watcher.verdicts
        cameras = {camera.name: camera for camera in self.settings.cameras}
        lacks = {n: starvation(c, counts[n], self.node) for n, c in cameras.items()}
        solver = SolverState(
            step=self.worker.step,
            in_force=self._in_force_run,
            last_run=self._last_run,
            last_status=self._last_status,
            last_message=self._last_message,
            last_reasons=self._last_reasons,
            last_took_s=self._last_took_s,
            last_ended_s=self._last_ended_s,
        )
        lost = self._intake.lost()
        newly_lost, self._lost = lost != self._lost, lost
        array = DiagnosticArray(
            status=[
                solver_status(prefix, solver),
                load_status(prefix, self._meter.load(), lost, newly_lost=newly_lost),
                *(
                    camera_status(prefix, c, counts[n], lacks[n], verdicts.get(n))
                    for n, c in cameras.items()
                ),
            ]
        )
        array.header.stamp = self.node.get_clock().now().to_msg()
        self._diagnostics.publish(array)
        return lacks

    def _change_parameters(self, changes: Iterable[Any]) -> SetParametersResult:
        """Take over what changes at run time; those that are fixed never come here."""
        changed = {p.name: p.value for p in changes if p.name in self._values}
        values = self._values | changed
        try:
            settings = settings_from(values, node_name=self.node.get_fully_qualified_name())
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        before, self.settings, self._values = self.settings, settings, values
        if settings.watch != before.watch:
            self._begin_watch()
        self.buffers.set_limits(settings.limits)
        return SetParametersResult(successful=True)

    def _offsets(self) -> dict[str, float]:
        cameras = () if self.in_force is None else self.in_force.calibration.cameras
        return {camera.name: camera.time_offset_s for camera in cameras}

    def _rates(self) -> dict[str, float]:
        return {name: counts.rate_hz for name, counts in self.buffers.counts().items()}

    def _say(self, about: str, line: str, *, every_s: float = _REPEAT_S) -> None:
        """Warn, about one thing only so often."""
        now = time.monotonic()
        if now - self._said.get(about, -math.inf) >= every_s:
            self._said[about] = now
            self.log.warning(line)


def _saved_run(kept: Kept) -> str:
    return f"saved-{kept.number:06d}"


def main() -> int:
    """Run the node until SIGINT or SIGTERM.

    Returns
    -------
    int
        Exit status: 0 stopped, 2 unusable parameters.
    """
    stop = stop_on_signals()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("calibrator")
    try:
        calibrator = Calibrator(node)
    except InputError as error:
        print(f"calibrator: {error}", file=sys.stderr)
        return 2
    # What is there now stays: the collector would look through it again and again, 60 ms each time.
    gc.collect()
    gc.freeze()
    spin_until(stop, node)
    if not calibrator.worker.stop(_STOP_S):
        # The solver is in the middle of a long step. Nothing is being written: leave it.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)
    calibrator.services.destroy()
    node.destroy_node()
    rclpy.shutdown()
    return 0
