"""Start and stop of the executables."""

from __future__ import annotations

import re
import signal
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from stcalib_ros.core.errors import InputError, one_line
from stcalib_ros.ros.limits import MAX_LINE, SPIN_S
from stcalib_ros.ros.throttle import Throttle

_SOURCE = re.compile(r", at \S+:\d+")
"""Place in the sources of rcl, at the end of what it says."""


class StopRequest:
    """Whether the process was asked to stop; the handler of a signal may say so at any moment.

    A `threading.Event` may not be set there: its lock is not reentrant, and a signal that comes
    while the same thread holds it in `wait` stands still for ever. `SimpleQueue.put` is reentrant.
    """

    def __init__(self) -> None:
        self._requested = False
        self._wake: SimpleQueue[None] = SimpleQueue()

    def set(self) -> None:
        """Ask to stop, and end a `wait`."""
        self._requested = True
        self._wake.put(None)

    def is_set(self) -> bool:
        """Return whether it was asked."""
        return self._requested

    def wait(self, timeout_s: float) -> bool:
        """Wait until it is asked, `timeout_s` seconds at most; return whether it was."""
        if not self._requested:
            with suppress(Empty):
                self._wake.get(timeout=timeout_s)
        return self._requested


def stop_on_signals() -> StopRequest:
    """Return a request that SIGINT and SIGTERM set from now on."""
    stop = StopRequest()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    return stop


@contextmanager
def running_node(name: str) -> Iterator[tuple[Any, StopRequest]]:
    """Start ROS and a node, and stop both in the end.

    Yields
    ------
    node : rclpy.node.Node
    stop : StopRequest
        Set by SIGINT and SIGTERM.

    Raises
    ------
    InputError
        As `start_node`.
    """
    stop = stop_on_signals()
    node = start_node(name)
    try:
        yield node, stop
    finally:
        node.destroy_node()
        rclpy.shutdown()


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


def spin_until(stop: StopRequest, node: Any, executor: Any = None) -> None:
    """Serve a node until `stop` is set; what goes wrong in one callback ends nothing else.

    Parameters
    ----------
    stop : StopRequest
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
