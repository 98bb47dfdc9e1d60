"""From a topic into the buffers: messages come as bytes and are decoded by us; knows no ROS."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

from stcalib_ros.io.message_types import TYPES, decode
from stcalib_ros.io.messages import NS, stamp_ns
from stcalib_ros.io.person_topics import with_person_of_topic
from stcalib_ros.io.topics import SelectedCamera
from stcalib_ros.ros.buffers import Buffers
from stcalib_ros.ros.gathering import Gatherer
from stcalib_ros.ros.load import LossCounter, Meter

Take = Callable[[bytes, Mapping[str, Any]], None]
"""Callback of a subscription with ``raw=True``: the bytes, and rclpy's information about them."""

_STAMP = slice(4, 12)
"""Of a message with a header: after the encapsulation header of CDR."""


class Intake:
    """Decodes what comes of every camera, and sees to it that nothing is lost unnoticed.

    Parameters
    ----------
    cameras : sequence of SelectedCamera
    buffers : Buffers
    meter : Meter
        Called with every message of poses.
    """

    def __init__(self, cameras: Sequence[SelectedCamera], buffers: Buffers, meter: Meter) -> None:
        self._buffers, self._meter = buffers, meter
        self._losses = {camera.name: LossCounter() for camera in cameras}
        self._people: dict[str, dict[str, LossCounter]] = {camera.name: {} for camera in cameras}
        self._gatherers = {camera.name: Gatherer() for camera in cameras}

    def lost(self) -> dict[str, int]:
        """Messages of poses, by camera, that were published while we listened and never came."""
        return {
            name: counter.lost + sum(one.lost for one in self._people[name].values())
            for name, counter in self._losses.items()
        }

    def poses_of(self, camera: SelectedCamera) -> Take:
        """Callback for the poses of a camera."""
        name, topic, kind = camera.name, camera.pose_topic, camera.pose_type
        return self._taking(name, topic, kind, self._losses[name], self._buffers.add_poses)

    def person_of(self, camera: SelectedCamera, topic: str, kind: str) -> Take:
        """Callback for one of the topics of a camera of which every person has their own.

        Parameters
        ----------
        camera : SelectedCamera
        topic, kind : str
            Name and type of the topic.
        """
        losses = self._people[camera.name].setdefault(topic, LossCounter())
        gather = self._gatherers[camera.name].add

        def add(name: str, message: SimpleNamespace) -> None:
            message = with_person_of_topic(message, topic, kind)
            try:
                complete = gather(message) if stamp_ns(message) else [message]
            except ValueError as error:
                self._buffers.reject(name, f"{topic}: {error}")
                return
            self._buffers.heard(name)
            for image in complete:
                self._buffers.add_poses(name, image)

        return self._taking(camera.name, topic, kind, losses, add)

    def forget_person(self, camera: SelectedCamera, topic: str) -> None:
        """Take note that a topic of `person_of` is not listened to any more."""
        self._losses[camera.name].lost += self._people[camera.name].pop(topic).lost

    def _taking(
        self,
        name: str,
        topic: str,
        kind: str,
        losses: LossCounter,
        add: Callable[[str, SimpleNamespace], None],
    ) -> Take:
        def take(data: bytes, about: Mapping[str, Any]) -> None:
            begin = time.perf_counter()
            losses.came(about["publication_sequence_number"])
            message = self._decoded(name, topic, kind, data)
            if message is not None:
                add(name, message)
            else:
                self._buffers.heard(name)
            self._meter.waited((time.time_ns() - about["received_timestamp"]) / NS)
            self._meter.held(time.perf_counter() - begin)

        return take

    def info_of(self, camera: SelectedCamera) -> Take:
        """Callback for the CameraInfo of a camera; one that repeats itself is decoded once."""
        last: tuple[bytes, SimpleNamespace] | None = None

        def take(data: bytes, _about: Mapping[str, Any]) -> None:
            nonlocal last
            begin = time.perf_counter()
            key = data[: _STAMP.start] + data[_STAMP.stop :]
            if last is None or last[0] != key:
                message = self._decoded(camera.name, camera.info_topic, camera.info_type, data)
                last = None if message is None else (key, message)
            if last is not None:
                self._buffers.add_info(camera.name, last[1])
            self._meter.held(time.perf_counter() - begin)

        return take

    def _decoded(self, name: str, topic: str, kind: str, data: bytes) -> SimpleNamespace | None:
        if len(data) > (most := self._buffers.max_bytes * TYPES[kind].bytes_factor):
            self._buffers.reject(
                name,
                f"{topic}: a message of {len(data)} bytes; max_persons and max_joints allow no "
                f"more than {most}",
            )
            return None
        try:
            return decode(kind, data)
        except (ValueError, struct.error) as error:
            self._buffers.reject(name, f"{topic}: not a readable {kind}: {error}")
            return None
