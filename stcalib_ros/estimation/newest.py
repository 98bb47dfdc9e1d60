"""Images that wait for an estimator: the newest of each camera, and each camera in turn."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")

EARLY = 0.1
"""Fraction of the period. An image that is early by less is picked: stamps have jitter. Chosen."""


@dataclass(frozen=True, slots=True)
class Counted:
    """What has become of the images of one camera.

    Attributes
    ----------
    received : int
    not_needed : int
        That came sooner than the rate asks for.
    dropped : int
        That were needed, and were replaced by a newer one before their turn.
    taken : int
    """

    received: int = 0
    not_needed: int = 0
    dropped: int = 0
    taken: int = 0


@dataclass(slots=True)
class _Slot(Generic[T]):
    """One camera: when its next image is due by its own stamps, and the image that waits."""

    due_s: float = -math.inf
    last_s: float = -math.inf
    waiting: list[T] | None = None
    busy: bool = False
    turn: int = 0
    received: int = 0
    not_needed: int = 0
    dropped: int = 0
    taken: int = 0


class NewestImages(Generic[T]):
    """Images of several cameras that wait for estimators; used by several threads.

    The newest of a camera wins: nothing lags. Of the cameras with an image the one that has waited
    for its turn the longest is next. A camera whose image is being used has its next turn after
    `done`, so that its images stay in order.

    Parameters
    ----------
    cameras : iterable of str
    rate_hz : float
        Images of a camera that are needed, 1/s by its stamps, on average; 0: all.

    Examples
    --------
    >>> images = NewestImages[str](["cam0", "cam1"], rate_hz=10.0)
    >>> for stamp_s, image in ((0.0, "a"), (0.05, "b"), (0.1, "c")):
    ...     images.put("cam0", stamp_s, image)
    >>> images.put("cam1", 7.0, "d")
    >>> images.take(0.0), images.take(0.0), images.take(0.0)
    (('cam0', 'c'), ('cam1', 'd'), None)
    >>> images.done("cam0")
    >>> images.counted("cam0")
    Counted(received=3, not_needed=1, dropped=1, taken=1)
    """

    def __init__(self, cameras: Iterable[str], *, rate_hz: float) -> None:
        self._period_s = 1.0 / rate_hz if rate_hz > 0 else 0.0
        self._slots: dict[str, _Slot[T]] = {name: _Slot() for name in cameras}
        self._changed = threading.Condition()
        self._turn = 0

    def put(self, camera: str, stamp_s: float, image: T) -> None:
        """Leave an image for the estimator, in the place of the one that waits, if it is needed."""
        with self._changed:
            slot = self._slots[camera]
            slot.received += 1
            if stamp_s < slot.last_s:
                slot.due_s = -math.inf
            slot.last_s = stamp_s
            if stamp_s < slot.due_s - EARLY * self._period_s:
                slot.not_needed += 1
                return
            on_time = slot.due_s + self._period_s
            slot.due_s = on_time if on_time > stamp_s else stamp_s + self._period_s
            slot.dropped += slot.waiting is not None
            slot.waiting = [image]
            self._changed.notify()

    def take(self, timeout_s: float) -> tuple[str, T] | None:
        """Return the camera whose turn it is, and its image; None if none comes in time."""
        with self._changed:
            self._changed.wait_for(self._next, timeout_s)
            if (name := self._next()) is None:
                return None
            slot = self._slots[name]
            assert slot.waiting is not None
            (image,), slot.waiting = slot.waiting, None
            self._turn += 1
            slot.turn, slot.busy = self._turn, True
            slot.taken += 1
            return name, image

    def done(self, camera: str) -> None:
        """Say that the image of a camera that was taken has been used."""
        with self._changed:
            self._slots[camera].busy = False
            self._changed.notify()

    def counted(self, camera: str) -> Counted:
        """Return what has become of the images of a camera."""
        with self._changed:
            slot = self._slots[camera]
            return Counted(slot.received, slot.not_needed, slot.dropped, slot.taken)

    def _next(self) -> str | None:
        waiting = [name for name, slot in self._slots.items() if slot.waiting and not slot.busy]
        return min(waiting, key=lambda name: self._slots[name].turn, default=None)
