"""Warnings of the buffers, of which those that clear up are held back; knows no ROS."""

from __future__ import annotations

import time
from collections.abc import Callable

from stcalib_ros.ros.limits import ASIDE_WARN_S, REPEAT_RESTART_S
from stcalib_ros.ros.throttle import Throttle

ASIDE, FLUSH, RESTART = "aside", "flush", "restart"
"""Kinds of events of a camera: images were set aside; what was there is discarded since the camera
has changed; likewise, since time has begun again."""


class BufferWarnings:
    """Passes warnings on, each subject now and then.

    Images that were set aside are reported if it is not clear after a while what they are: a camera
    that has changed is reported as that. If time begins again for several cameras, as when a bag is
    played in a loop, that is one warning, repeated seldom.

    Parameters
    ----------
    throttle : Throttle
    clock : callable
        Steady, seconds.
    """

    def __init__(self, throttle: Throttle, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._throttle, self._clock = throttle, clock
        self._aside: dict[str, tuple[float, str]] = {}
        self._restarts: dict[str, tuple[float, str]] = {}

    def __call__(self, subject: str, line: str) -> None:
        """Take a warning of a camera.

        Parameters
        ----------
        subject : str
            Name of the camera, a colon, and the kind of event.
        line : str
        """
        camera, _, kind = subject.rpartition(": ")
        if kind == ASIDE:
            self._aside.setdefault(camera, (self._clock(), line))
            return
        if kind in (FLUSH, RESTART):
            self._aside.pop(camera, None)
        if kind == RESTART:
            self._restarts.setdefault(camera, (self._clock(), line))
        else:
            self._throttle(subject, line)

    def settle(self) -> None:
        """Pass on what has not cleared up; to be called every second."""
        now_s = self._clock()
        for camera, (since_s, line) in list(self._aside.items()):
            if now_s - since_s >= ASIDE_WARN_S:
                del self._aside[camera]
                self._throttle(f"{camera}: {ASIDE}", line)
        times_s = [since_s for since_s, _ in self._restarts.values()]
        if not times_s or now_s - min(times_s) < ASIDE_WARN_S:
            return
        restarts, self._restarts = self._restarts, {}
        if len(restarts) == 1:
            ((camera, (_, line)),) = restarts.items()
            self._throttle(f"{camera}: {RESTART}", line)
            return
        self._throttle(
            RESTART,
            f"time begins again for {', '.join(restarts)}, as when a bag is played in a loop; "
            "what was received before is discarded",
            every_s=REPEAT_RESTART_S,
        )
