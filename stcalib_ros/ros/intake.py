"""From a topic into the buffers: messages come as bytes and are decoded by us; knows no ROS."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

from stcalib_ros.io.message_types import TYPES, decode
from stcalib_ros.io.messages import NS
from stcalib_ros.io.topics import SelectedCamera
from stcalib_ros.ros.buffers import Buffers
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

    def lost(self) -> dict[str, int]:
        """Messages of poses, by camera, that were published while we listened and never came."""
        return {name: counter.lost for name, counter in self._losses.items()}

    def poses_of(self, camera: SelectedCamera) -> Take:
        """Callback for the poses of a camera."""
        losses, add = self._losses[camera.name], self._buffers.add_poses

        def take(data: bytes, about: Mapping[str, Any]) -> None:
            begin = time.perf_counter()
            losses.came(about["publication_sequence_number"])
            message = self._decoded(camera.name, camera.pose_topic, camera.pose_type, data)
            if message is not None:
                add(camera.name, message)
            else:
                self._buffers.heard(camera.name)
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
                f"{topic}: a message of {len(data)} bytes; with max_persons and max_joints as they "
                f"are, none has more than {most}",
            )
            return None
        try:
            return decode(kind, data)
        except (ValueError, struct.error) as error:
            self._buffers.reject(name, f"{topic}: not a readable {kind}: {error}")
            return None
