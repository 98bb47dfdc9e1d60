"""Start and stop of the executables."""

from __future__ import annotations

import signal
import threading
from typing import Any

from rclpy.executors import SingleThreadedExecutor

from stcalib_ros.ros.limits import SPIN_S


def stop_on_signals() -> threading.Event:
    """Return an event that SIGINT and SIGTERM set from now on."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    return stop


def spin_until(stop: threading.Event, node: Any) -> None:
    """Serve a node until `stop` is set."""
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    while not stop.is_set() and node.context.ok():
        executor.spin_once(timeout_sec=SPIN_S)
    executor.shutdown()
