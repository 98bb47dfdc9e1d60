"""Start and stop of the executables."""

from __future__ import annotations

import re
import signal
import sys
import threading
import traceback
from itertools import pairwise
from pathlib import Path
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from stcalib_ros.core.errors import InputError, one_line
from stcalib_ros.ros.limits import MAX_LINE, SPIN_S
from stcalib_ros.ros.throttle import Throttle

_SOURCE = re.compile(r", at \S+:\d+")
"""Place in the sources of rcl, at the end of what it says."""


def stop_on_signals() -> threading.Event:
    """Return an event that SIGINT and SIGTERM set from now on."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    return stop


def start_node(name: str) -> Any:
    """Start ROS by the arguments of the process, and return a node.

    Raises
    ------
    InputError
        A file of parameters is missing, or it or another argument of ROS cannot be used.
    """
    for word, file in pairwise(sys.argv):
        if word == "--params-file" and not Path(file).is_file():
            raise InputError(f"--params-file: no such file: {file}")
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        return rclpy.create_node(name)
    except RuntimeError as error:  # all that rcl says
        said = _SOURCE.sub("", str(error)).removeprefix("failed to initialize rcl: ")
        raise InputError(f"arguments of ROS: {one_line(said, MAX_LINE)}") from None


def events_executor(context: Any) -> Any:
    """Return an executor that takes a fifth less CPU time per large message than the usual one.

    It waits for events instead of asking all entities of the node in turn; older versions of rclpy
    do not have it, then it is the usual one.
    """
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)


def spin_until(stop: threading.Event, node: Any, executor: Any = None) -> None:
    """Serve a node until `stop` is set; what goes wrong in one callback ends nothing else.

    Parameters
    ----------
    stop : threading.Event
    node : rclpy.node.Node
    executor : rclpy.executors.Executor, optional
        Default: a single-threaded one.
    """
    executor = executor or SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    throttle = Throttle(node.get_logger().error)
    while not stop.is_set() and node.context.ok():
        _spin_once(executor, throttle)
    executor.shutdown()


def _spin_once(executor: Any, throttle: Throttle) -> None:
    try:
        executor.spin_once(timeout_sec=SPIN_S)
    except ExternalShutdownException:
        return  # the context is no longer ok
    except Exception as error:  # a fault of ours, which no sender may turn into an end
        where = traceback.extract_tb(error.__traceback__)[-1]
        what = one_line(f"{type(error).__name__}: {error}", MAX_LINE)
        throttle(
            type(error).__name__,
            f"an unforeseen error, please report it: {what} ({where.filename}:{where.lineno})",
        )
