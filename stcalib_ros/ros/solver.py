"""The calibration in a process of its own; knows no ROS.

In a process of its own the solver's memory goes back to the system when it ends and has a limit, it
does not compete with the callbacks of the node for Python's lock, can be stopped at any time, and
takes nothing with it if memory runs out.
"""

from __future__ import annotations

import math
import os
import resource
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from stcalib_ros.core.errors import Cancelled, StcalibError
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.options import Options
from stcalib_ros.io.assemble import CameraImages, assemble_recording
from stcalib_ros.ros.limits import PAIR_MB, SOLVER_MB
from stcalib_ros.threads import use_one_thread

_POLL_S = 0.05
"""Seconds. Cancelling takes effect within this."""
_NICE = 5
"""Niceness of the process: on a busy machine messages go first."""
_IMAGES_AT_ONCE = 100
"""Images. Pickling one such piece holds Python's lock for about a millisecond."""
_RESULT, _ERROR = "result", "error"


class SolverError(StcalibError):
    """The solver's process ended without a result, or stumbled over something unforeseen."""


def calibrate_in_subprocess(
    cameras: list[CameraImages],
    options: Options,
    *,
    cancelled: Callable[[], bool],
    memory_mb: float | None = None,
    **listeners: Callable[..., None],
) -> Calibration:
    """Assemble what arrived of the cameras and calibrate, in a process of its own.

    Parameters
    ----------
    cameras : list of CameraImages
        Emptied while it is handed over, so that no image is kept longer than necessary.
    options : Options
    cancelled : callable
        Polled every `_POLL_S`; the process is killed when it returns true.
    memory_mb : float
        Memory that the process may take beside the images; None: `SOLVER_MB`, and `PAIR_MB` for
        each pair of cameras.
    **listeners : callable
        ``warn`` of `assemble_recording`, and any of `calibrate`'s, such as ``progress``; called
        in the caller's thread.

    Raises
    ------
    Cancelled
        `cancelled` returned true.
    InputError
        The data cannot be used.
    SolverError
        The process was killed, or the calibration raised anything else.
    """
    if memory_mb is None:
        memory_mb = SOLVER_MB + PAIR_MB * math.comb(len(cameras), 2)
    use_one_thread()  # the process has the environment of this one
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(
        target=_serve,
        args=(theirs, options, tuple(listeners), memory_mb),
        name="solver",
        daemon=True,
    )
    with _without_interrupts():
        process.start()
    theirs.close()
    try:
        _send(ours, cameras, cancelled)
        return _followed(ours, cancelled, listeners)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        process.join()
        raise SolverError(
            f"the solver's process has died (exit code {process.exitcode}); if memory "
            f"ran out (it may use {memory_mb:.0f} MB beside the images), make window_s smaller"
        ) from None
    finally:
        process.kill()
        process.join()
        ours.close()


def _send(to: Connection, cameras: list[CameraImages], cancelled: Callable[[], bool]) -> None:
    """Hand over piece by piece: pickling holds Python's lock."""
    to.send(len(cameras))
    while cameras:
        camera = cameras.pop(0)
        to.send((replace(camera, images=()), len(camera.images)))
        for k in range(0, len(camera.images), _IMAGES_AT_ONCE):
            if cancelled():
                raise Cancelled("cancelled during assembly")
            to.send(camera.images[k : k + _IMAGES_AT_ONCE])


def _received(source: Connection) -> list[CameraImages]:
    cameras = []
    for _ in range(source.recv()):
        camera, n_images = source.recv()
        images: list[Any] = []
        while len(images) < n_images:
            images += source.recv()
        cameras.append(replace(camera, images=images))
    return cameras


def _followed(
    source: Connection,
    cancelled: Callable[[], bool],
    listeners: dict[str, Callable[..., None]],
) -> Calibration:
    """Pass on what the process reports until it has a result."""
    stage = "assembly"
    while True:
        while not source.poll(_POLL_S):
            if cancelled():
                raise Cancelled(f"cancelled during {stage}")
        kind, content = source.recv()
        if kind == _RESULT:
            return content  # type: ignore[no-any-return]
        if kind == _ERROR:
            raise content
        if kind == "progress":
            stage = content[0]
        listeners[kind](*content)


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Ctrl-C reaches all processes of a terminal; one that is started here does not hear it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(pipe: Connection, options: Options, events: Sequence[str], memory_mb: float) -> None:
    """Main function of the process; ends silently when the other end of the pipe is gone."""
    os.nice(_NICE)
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        pipe.send(_answer(pipe, options, events, memory_mb))


def _answer(
    pipe: Connection, options: Options, events: Sequence[str], memory_mb: float
) -> tuple[str, object]:
    """Receive the data and calibrate; return what to send at the end."""
    from stcalib_ros.core.pipeline import calibrate  # here: the node needs nothing of it

    listeners = {event: partial(_send_event, pipe, event) for event in events}
    warn = listeners.pop("warn")
    try:
        cameras = _received(pipe)
        threading.Thread(target=_end_with, args=(pipe,), daemon=True).start()
        _limit_memory(memory_mb)
        recording = assemble_recording(cameras, warn=warn)
        del cameras
        return _RESULT, calibrate(recording, options, **listeners)  # type: ignore[arg-type]
    except (EOFError, BrokenPipeError, ConnectionResetError):
        raise
    except StcalibError as error:
        return _ERROR, error
    except MemoryError:
        return _ERROR, SolverError(
            f"the solver needs more than {memory_mb:.0f} MB beside the images: make window_s "
            "smaller, or let the pose estimator keep track ids longer"
        )
    except Exception as error:  # the node goes on, whatever the solver stumbles over
        return _ERROR, SolverError(f"{type(error).__name__}: {error}")


def _limit_memory(megabytes: float) -> None:
    """Let this process take so much more memory than it has; beyond that it gets a MemoryError.

    Does nothing where the system does not say what it has (/proc).
    """
    try:
        status = Path("/proc/self/status").read_text()
    except OSError:
        return
    sizes = (line.split()[1] for line in status.splitlines() if line.startswith("VmData:"))
    limit = int(next(sizes)) * 1024 + round(megabytes * 1e6)
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    if hard in (resource.RLIM_INFINITY, -1) or limit < hard:
        resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))


def _send_event(pipe: Connection, event: str, *content: Any) -> None:
    pipe.send((event, content))


def _end_with(pipe: Connection) -> None:
    """End when the other end of the pipe is gone: the node may have been killed."""
    try:
        pipe.recv()
    except (EOFError, OSError):
        os._exit(1)
