"""Poses of films: an estimator run on their images, film by film, in several processes."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from stcalib_ros.core.errors import InputError
from stcalib_ros.estimation.parts import FilmParts, TimedPoses
from stcalib_ros.estimation.poses import PoseEstimator
from stcalib_ros.io.film_files import film_id
from stcalib_ros.io.films import Film, expected_images, film_images

_PART_IMAGES = 16
"""Images of a part: as many are estimated again after a power failure, a second's work. Chosen."""
_LOOK_EVERY_S = 0.3
"""Seconds between two looks at how far other processes are. Chosen."""

MakeEstimator = Callable[[], PoseEstimator]
"""Makes an estimator; other processes call it, too: a function of a module, or a partial of one."""

FilmProgress = Callable[[int, int, float], None]
"""Called with the images done, about how many there are, and about the seconds left (NaN: unknown).
"""


@dataclass(frozen=True, slots=True)
class FilmTask:
    """What one process is to do.

    Attributes
    ----------
    film : Film
    identity : str
        Of the film, by `film_id`.
    parts : FilmParts
        Where its poses are kept.
    limit_hz : float
        Images a second, at most.
    stop : Path
        When this file is there, the work ends after the image at hand.
    """

    film: Film
    identity: str
    parts: FilmParts
    limit_hz: float
    stop: Path


def estimate_films(
    tasks: Sequence[FilmTask],
    make_estimator: MakeEstimator,
    *,
    executor: Executor | None = None,
    progress: FilmProgress | None = None,
) -> None:
    """Estimate the poses of films as far as they are not there yet.

    If anything ends it, Ctrl-C included, all images that are done are in the parts.

    Parameters
    ----------
    tasks : sequence of FilmTask
        With one file `stop`, which is not there.
    make_estimator : callable
    executor : Executor, optional
        Its processes take a film each. Default: this process does all of them.
    progress : callable, optional

    Raises
    ------
    InputError
        A film cannot be read to its end, or was changed in the meantime; or a process died.
    """
    todo = [task for task in tasks if not task.parts.is_whole()]
    left = _TimeLeft(tasks)

    def look() -> None:
        if progress is not None:
            progress(*left.now())

    if executor is None:
        estimator = make_estimator()
        for task in todo:
            _estimate_film(task, estimator, look)
        return
    pending: set[Future[None]] = set()
    try:
        with _stopped_if_unfinished(tasks[0].stop, pending):
            with _interrupts_wait():
                pending.update(executor.submit(_run_task, task, make_estimator) for task in todo)
            while pending:
                done, _ = wait(pending, timeout=_LOOK_EVERY_S)
                pending -= done
                for future in done:
                    future.result()
                look()
    except BrokenProcessPool as error:
        raise InputError(
            "a process that estimated poses has died, as for lack of memory: run the command "
            "again with --jobs 1; images that are done are kept"
        ) from error


@contextmanager
def _stopped_if_unfinished(stop: Path, pending: Collection[Future[None]]) -> Iterator[None]:
    """Have other processes end, and wait until they have kept their images, if anything fails."""
    with ExitStack() as unfinished:
        unfinished.callback(_stop, stop, pending)
        yield
        unfinished.pop_all()


def _stop(stop: Path, pending: Collection[Future[None]]) -> None:
    with _interrupts_wait():
        stop.touch()
        wait([future for future in pending if not future.cancel()])


@contextmanager
def _interrupts_wait() -> Iterator[None]:
    """Have Ctrl-C wait; processes that begin in here never see it: it is for this one alone."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _run_task(task: FilmTask, make_estimator: MakeEstimator) -> None:
    _estimate_film(task, make_estimator(), lambda: None)


def _estimate_film(task: FilmTask, estimator: PoseEstimator, look: Callable[[], None]) -> None:
    waiting: list[TimedPoses] = []
    images = film_images(task.film, limit_hz=task.limit_hz, skip=task.parts.n_done())
    try:
        for stamp_s, image in images:
            if task.stop.exists():
                return
            waiting.append(TimedPoses(stamp_s, estimator.poses(image)))
            if len(waiting) == _PART_IMAGES:
                task.parts.add(waiting)
                waiting.clear()
                look()
    finally:
        task.parts.add(waiting)
    if film_id(task.film.path) != task.identity:
        raise InputError(
            f"{task.film.path} was changed while it was read: if it is still being written, wait "
            "until it is finished, and run the command again"
        )
    task.parts.finish()


class _TimeLeft:
    """How far all films are, and when they will be done at the pace so far."""

    def __init__(self, tasks: Sequence[FilmTask]) -> None:
        self._tasks = tasks
        self._expected = [expected_images(task.film, task.limit_hz) for task in tasks]
        self._begin_s = time.monotonic()
        self._before = sum(task.parts.n_done() for task in tasks)

    def now(self) -> tuple[int, int, float]:
        """Images done, images in all, and seconds left (NaN: unknown)."""
        counts = [task.parts.n_done() for task in self._tasks]
        whole = [task.parts.is_whole() for task in self._tasks]
        totals = [
            count if done else max(count, expected)
            for count, done, expected in zip(counts, whole, self._expected, strict=True)
        ]
        n, total = sum(counts), sum(totals)
        new = n - self._before
        pace_s = (time.monotonic() - self._begin_s) / new if new else float("nan")
        return n, total, (total - n) * pace_s
