"""Processes for the parts of a calibration that do not depend on one another."""

from __future__ import annotations

import argparse
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context

from stcalib_ros.threads import use_one_thread

# Nothing here may import NumPy: workers set the number of its threads before they do.


def count(text: str) -> int:
    """Number of processes, as an argument.

    Raises
    ------
    argparse.ArgumentTypeError
        It is not a whole number of at least 1.
    """
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number of at least 1, got {text!r}")
    return int(text)


@contextmanager
def processes(n: int) -> Iterator[Executor | None]:
    """Executor of `n` processes with one thread each; None for one process, which is this one."""
    if n == 1:
        yield None
        return
    pool = ProcessPoolExecutor(n, mp_context=get_context("spawn"), initializer=_prepare)
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _prepare() -> None:
    """One thread; an interrupt is for the process that gave the task."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    use_one_thread()
