"""Observer of a live node from outside: its topics, its memory, its CPU time."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from stcalib_ros.msg import CalibrationResult
from std_srvs.srv import Trigger

from benchmarks.cost.process import usage
from benchmarks.live.figures import Observed, Sample, Solve
from benchmarks.live.player import Sent

_EVERY_S = 1.0
"""Seconds between samples."""
_SPIN_S = 0.05
"""Longest wait for a ROS event, s."""


class Watcher:
    """ROS node in this process that observes another one.

    Parameters
    ----------
    name : str
        Name of the observed node.
    pid : int
        Process id of the observed node.
    first_after_s, pause_s : float
        Time of the first request for a calibration, and pause after its end before the next.
    """

    def __init__(self, name: str, pid: int, *, first_after_s: float, pause_s: float) -> None:
        self._name, self._pid = name, pid
        self._first_after_s, self._pause_s = first_after_s, pause_s
        self._context = rclpy.Context()
        self._context.init()
        self._node = rclpy.create_node("watcher", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._diagnosed, 10)
        deep = QoSProfile(depth=10)
        self._node.create_subscription(CalibrationResult, f"/{name}/result", self._came, deep)
        self._client = self._node.create_client(Trigger, f"/{name}/recalibrate_now")
        self._status: dict[str, dict[str, str]] = {}
        self._arrivals: dict[str, float] = {}
        self._solves: dict[str, Solve] = {}
        self._samples: list[Sample] = []
        self._asked = False

    def close(self) -> None:
        """Leave the ROS graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.shutdown()

    def watch(self, seconds: float, *, solving: bool = False) -> None:
        """Observe for a time; with `solving`, request one calibration after the other."""
        begin = now = time.monotonic()
        sample_at, ask_at = begin, begin + self._first_after_s
        while now < begin + seconds:
            self._executor.spin_once(timeout_sec=_SPIN_S)
            now = time.monotonic()
            if now >= sample_at:
                self._sample(now)
                sample_at += _EVERY_S
            if not solving:
                continue
            if self._running():
                ask_at = now + self._pause_s
            elif now >= ask_at:
                self._client.call_async(Trigger.Request())
                ask_at = now + self._pause_s

    def observed(self, sent: Mapping[str, Sent], status: int, stop_s: float) -> Observed:
        """Return all observations; the arguments are those from elsewhere."""
        of_cameras = {name: self._status.get(f"camera {name}", {}) for name in sent}
        return Observed(
            sent=dict(sent),
            received={n: int(s.get("received", 0)) for n, s in of_cameras.items()},
            dropped={n: int(s.get("dropped", 0)) for n, s in of_cameras.items()},
            buffered={n: int(s.get("images", 0)) for n, s in of_cameras.items()},
            lost=int(self._status.get("load", {}).get("lost", 0)),
            solves=list(self._solves.values()),
            samples=self._samples,
            exit_status=status,
            stop_s=stop_s,
        )

    def _running(self) -> bool:
        return self._status.get("solver", {}).get("state") == "running"

    def _sample(self, now: float) -> None:
        load = self._status.get("load")
        if load is None:
            return
        figures = {k: float(v) for k, v in load.items() if k.endswith("_ms")}
        n = int(load["messages_per_minute"])
        self._samples.append(Sample(now, self._running(), usage(self._pid), n, figures))

    def _came(self, result: Any) -> None:
        self._arrivals.setdefault(result.run_id, time.time())

    def _diagnosed(self, array: Any) -> None:
        prefix = f"{self._name}: "
        for status in array.status:
            if status.name.startswith(prefix):
                values = {v.key: v.value for v in status.values}
                self._status[status.name.removeprefix(prefix)] = values
        solver = self._status.get("solver", {})
        run = solver.get("last_run", "")
        if run and run not in self._solves:
            ended_s, arrived_s = float(solver["last_ended_s"]), self._arrivals.get(run)
            delay_s = float("nan") if arrived_s is None else arrived_s - ended_s
            took_s = float(solver["last_took_s"])
            self._solves[run] = Solve(run, solver["last_status"], took_s, delay_s)
