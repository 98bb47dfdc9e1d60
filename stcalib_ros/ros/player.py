"""Plays the messages of a bag as they are, in bag time or faster, with /clock if asked."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from stcalib_ros.io.bag import open_bag
from stcalib_ros.io.bag_records import RawMessage
from stcalib_ros.io.bag_source import raw_messages
from stcalib_ros.io.messages import NS
from stcalib_ros.io.topics import CameraSelection
from stcalib_ros.ros.convert import message_class
from stcalib_ros.ros.limits import LINGER_S
from stcalib_ros.ros.publishers import latched
from stcalib_ros.ros.running import StopRequest

_DEPTH = 1000
"""Messages. Queue of each publisher: a player may run faster than its subscribers."""
_POLL_S = 0.05
"""Seconds. Subscriptions are looked for this often."""


@dataclass(frozen=True, slots=True)
class PlayOptions:
    """How to play.

    Attributes
    ----------
    rate : float
        Seconds of the bag per second.
    clock_hz : float or None
        Messages on /clock per second; None: no /clock.
    loop : bool
        Begin again at the end.
    wait_s : float
        Longest time to wait for a subscription to every topic.
    """

    rate: float
    clock_hz: float | None
    loop: bool
    wait_s: float


class Player:
    """Publishers of a bag's poses and CameraInfo.

    Publishers are reliable, which serves best-effort subscriptions, too, and CameraInfo is latched.

    Parameters
    ----------
    node : rclpy.node.Node
    path : Path
        Bag.
    selection : CameraSelection
        Cameras to play.
    options : PlayOptions

    Raises
    ------
    InputError
        The bag cannot be used.
    """

    def __init__(
        self, node: Any, path: Path, selection: CameraSelection, options: PlayOptions
    ) -> None:
        self._log, self._options = node.get_logger(), options
        self._files, cameras = open_bag(path, selection=selection, warn=self._log.warning)
        reliable = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.RELIABLE)
        self._publishers: dict[str, Any] = {}
        for camera in cameras:
            for topic, type_name, qos in (
                *((topic, camera.pose_type, reliable) for topic in camera.pose_topics),
                (camera.info_topic, camera.info_type, latched()),
            ):
                kind = message_class(type_name)
                self._publishers[topic] = node.create_publisher(kind, topic, qos)
        self._clock = (
            None if options.clock_hz is None else node.create_publisher(Clock, "/clock", 10)
        )

    def play(self, stop: StopRequest) -> None:
        """Play to the end, or until `stop` is set.

        Raises
        ------
        InputError
            The bag is damaged.
        """
        self._wait(stop)
        while not stop.is_set():
            sent = self._play_once(stop)
            if stop.is_set() or not sent or not self._options.loop:
                break
            self._log.info("playing the bag again from its beginning: time jumps back")
        stop.wait(LINGER_S)

    def _play_once(self, stop: StopRequest) -> int:
        """Play from the beginning; return how many messages were sent."""
        rate, clock_hz = self._options.rate, self._options.clock_hz
        tick_ns = None if clock_hz is None else max(round(rate / clock_hz * NS), 1)
        messages = raw_messages(self._files, frozenset(self._publishers), in_time=True)
        begin, first_ns, sent = time.monotonic(), None, 0
        for now_ns, message in timeline(messages, tick_ns):
            first_ns = now_ns if first_ns is None else first_ns
            due = begin + (now_ns - first_ns) / NS / rate
            if stop.wait(max(due - time.monotonic(), 0.0)):
                break
            if message is not None:
                self._publishers[message.topic].publish(message.data)
                sent += 1
            elif self._clock is not None:
                sec, nanosec = divmod(now_ns, NS)
                self._clock.publish(Clock(clock=Time(sec=sec, nanosec=nanosec)))
        self._log.info(f"played {sent} messages")
        return sent

    def _wait(self, stop: StopRequest) -> None:
        """Wait for subscriptions, and warn of topics that have none."""
        deadline = time.monotonic() + self._options.wait_s
        publishers = dict(self._publishers)
        if self._clock is not None:
            publishers["/clock"] = self._clock
        while alone := [t for t, p in publishers.items() if not p.get_subscription_count()]:
            if time.monotonic() >= deadline:
                self._log.warning(f"nobody subscribes to {', '.join(alone)}; playing all the same")
                return
            if stop.wait(_POLL_S):
                return


def timeline(
    messages: Iterable[RawMessage], tick_ns: int | None
) -> Iterator[tuple[int, RawMessage | None]]:
    """Messages and, between them, ticks of a clock, each with its time.

    Parameters
    ----------
    messages : iterable of RawMessage
        Those out of order come with the time of the one before, which never goes back.
    tick_ns : int or None
        From one tick to the next, beginning with the first message; None: no ticks.

    Yields
    ------
    tuple
        Nanoseconds of bag time, and a message, or None for a tick; a tick comes before the messages
        of its time.
    """
    now_ns, next_ns = None, 0
    for message in messages:
        if now_ns is None:
            now_ns = next_ns = message.log_time
        now_ns = max(now_ns, message.log_time)
        while tick_ns is not None and next_ns <= now_ns:
            yield next_ns, None
            next_ns += tick_ns
        yield now_ns, message
