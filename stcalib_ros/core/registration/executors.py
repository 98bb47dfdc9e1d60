"""Independent tasks, distributed over the workers of an executor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from typing import TypeVar

from stcalib_ros.core.errors import CalibrationError

_POLL_S = 0.1
"""Seconds between two looks at whether the caller wants to stop. Chosen."""


_Task = TypeVar("_Task")


_Answer = TypeVar("_Answer")


def map_tasks(
    function: Callable[[_Task], _Answer],
    tasks: Sequence[_Task],
    executor: Executor | None,
    tick: Callable[[float], None],
) -> list[_Answer]:
    """Return the answers to tasks, in their order.

    Parameters
    ----------
    function : callable
    tasks : sequence
    executor : concurrent.futures.Executor or None
        None: one after the other, here.
    tick : callable
        Called with the fraction that is done, again and again; what it raises ends the work,
        and tasks that have not begun are cancelled.

    Raises
    ------
    CalibrationError
        A worker of the executor was lost.
    """
    if executor is None:
        answers = []
        for k, task in enumerate(tasks):
            tick(k / len(tasks))
            answers.append(function(task))
        return answers
    futures: list[Future[_Answer]] = []
    try:
        futures += (executor.submit(function, task) for task in tasks)
        _await(futures, tick)
        return [future.result() for future in futures]
    except BrokenExecutor as error:
        raise CalibrationError(
            "a worker process ended before its task was done: it was killed, perhaps for want of "
            "memory; use fewer processes (--jobs) or none"
        ) from error
    finally:
        for future in futures:
            future.cancel()


def _await(futures: Sequence[Future[_Answer]], tick: Callable[[float], None]) -> None:
    """Wait for all; the first that failed raises."""
    pending = set(futures)
    while pending:
        tick(1.0 - len(pending) / len(futures))
        done, pending = wait(pending, timeout=_POLL_S, return_when=FIRST_COMPLETED)
        for future in done:
            future.result()
