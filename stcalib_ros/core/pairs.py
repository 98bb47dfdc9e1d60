"""Pairs of cameras as independent tasks, for whatever executor there is.

A task is picklable and holds what its two cameras saw, not the recording: process pools and
clusters carry it elsewhere, and the answers are the same wherever they were found.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from stcalib_ros.core.epipolar import refine_pair
from stcalib_ros.core.errors import CalibrationError
from stcalib_ros.core.hypotheses import PairHypothesis, register_pair
from stcalib_ros.core.lift import LiftedCamera
from stcalib_ros.core.options import Options, RegistrationOptions
from stcalib_ros.core.skeleton import Skeleton
from stcalib_ros.core.timeline import GridTracks, sample_camera

_WORTH_REFINING = 0.3
_POLL_S = 0.1

_Task = TypeVar("_Task")
_Answer = TypeVar("_Answer")


@dataclass(frozen=True, slots=True, eq=False)
class PairTask:
    """Two cameras to be registered.

    Attributes
    ----------
    a, b : int
        Indices of the cameras, for the record.
    cameras : (LiftedCamera, LiftedCamera)
    grids : (GridTracks, GridTracks)
        Of the same cameras.
    max_lag : int
        Lags are searched within plus and minus this many samples.
    options : RegistrationOptions
    synchronised : bool
        The clocks are known to agree.
    """

    a: int
    b: int
    cameras: tuple[LiftedCamera, LiftedCamera]
    grids: tuple[GridTracks, GridTracks]
    max_lag: int
    options: RegistrationOptions
    synchronised: bool


def pair_tasks(
    lifted: Sequence[LiftedCamera],
    cameras: Sequence[int],
    skeleton: Skeleton,
    options: Options,
    *,
    start: float,
    step: float,
    n: int,
) -> list[PairTask]:
    """Tasks of all pairs of some cameras, sampled at the times ``start + step * k``, k < n."""
    grids = {c: sample_camera(lifted[c], skeleton, start=start, step=step, n=n) for c in cameras}
    max_lag = int(np.ceil(2.0 * options.offset_range_s / step))
    return [
        PairTask(
            a,
            b,
            (lifted[a], lifted[b]),
            (grids[a], grids[b]),
            max_lag,
            options.registration,
            options.synchronised,
        )
        for i, a in enumerate(cameras)
        for b in cameras[i + 1 :]
    ]


def registered(task: PairTask) -> tuple[PairHypothesis, ...]:
    """Hypotheses on a pair: by bone directions, and those refined on key points beside them."""
    found = register_pair(0, 1, *task.grids, task.max_lag, task.options)
    worth = [h for h in found if h.support >= _WORTH_REFINING * found[0].support]
    refined = (
        refine_pair(task.cameras, h, synchronised=task.synchronised)
        for h in worth[: task.options.n_refined]
    )
    hypotheses = (*found, *(h for h in refined if h is not None))
    return tuple(replace(h, a=task.a, b=task.b) for h in hypotheses)


def spread(
    function: Callable[[_Task], _Answer],
    tasks: Sequence[_Task],
    executor: Executor | None,
    tick: Callable[[float], None],
) -> list[_Answer]:
    """Answers to tasks, in their order.

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
