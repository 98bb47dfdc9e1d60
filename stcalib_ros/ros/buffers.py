"""What arrived of all cameras, in bounded memory; knows no ROS."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.io.assemble import CameraImages
from stcalib_ros.io.messages import NS, CameraInfoFields, PoseImage
from stcalib_ros.io.stamps import SAME_CLOCK, ClockCorrection
from stcalib_ros.io.topics import SelectedCamera
from stcalib_ros.ros.camera_buffer import CameraBuffer, Clock, Counts, Warn
from stcalib_ros.ros.lens_input import DriverImage
from stcalib_ros.ros.streams import Limits


class Buffers:
    """Buffers of all cameras; may be used from several threads.

    Parameters
    ----------
    cameras : sequence of SelectedCamera
    limits : Limits
    warn : callable
        Takes a subject, which is the camera's name with a kind of event, and a line that says what
        was dropped or forgotten and why.
    clock : callable
        Steady, seconds.

    Attributes
    ----------
    max_bytes : int
        A message that is longer cannot be within the limits.
    """

    def __init__(
        self,
        cameras: Sequence[SelectedCamera],
        limits: Limits,
        warn: Warn,
        *,
        clock: Clock = time.monotonic,
    ) -> None:
        self._lock = threading.Lock()
        self.max_bytes = limits.max_bytes

        def warn_of(name: str) -> Warn:
            return lambda subject, line: warn(f"{name}: {subject}", line)

        self._buffers = {c.name: CameraBuffer(c, limits, warn_of(c.name), clock) for c in cameras}

    def add_poses(self, name: str, message: Any) -> None:
        """Take in the poses of a camera, see `CameraBuffer.add_poses`."""
        with self._lock:
            self._buffers[name].add_poses(message)

    def add_info(self, name: str, message: Any) -> None:
        """Take in the CameraInfo of a camera, see `CameraBuffer.add_info`."""
        with self._lock:
            self._buffers[name].add_info(message)

    def heard(self, name: str) -> None:
        """Take note that a camera sends, though not an image: some send none without a person."""
        with self._lock:
            self._buffers[name].heard()

    def reject(self, name: str, why: str) -> None:
        """Count and report a message of a camera that cannot be read at all."""
        with self._lock:
            self._buffers[name].reject(why)

    def set_limits(self, limits: Limits) -> None:
        """Change the bounds; what they do not allow any more is discarded."""
        with self._lock:
            self.max_bytes = limits.max_bytes
            for buffer in self._buffers.values():
                buffer.set_limits(limits)

    def set_default(self, default: LensKnowledge) -> None:
        """Say what the CameraInfo of cameras is worth whose parameters do not."""
        with self._lock:
            for buffer in self._buffers.values():
                buffer.lens.default = default

    def counts(self) -> dict[str, Counts]:
        """State of every camera."""
        with self._settled() as buffers:
            return {name: buffer.counts() for name, buffer in buffers.items()}

    def newest_s(self) -> float:
        """Latest stamp of all images, seconds; NaN if there is none."""
        with self._settled() as buffers:
            stamps = [b.images[-1].stamp_ns for b in buffers.values() if b.images]
        return max(stamps) / NS if stamps else math.nan

    def moving(self) -> dict[str, frozenset[int]]:
        """Whole seconds, by the stamps of each camera that is ready, in which somebody moves."""
        with self._settled() as buffers:
            return {
                n: frozenset(b.moving)
                for n, b in buffers.items()
                if b.info is not None and b.no_lens is None
            }

    def snapshot(
        self,
        names: Iterable[str] = (),
        *,
        start_s: float = -math.inf,
        end_s: float = math.inf,
        clocks: Mapping[str, ClockCorrection] | None = None,
    ) -> list[CameraImages]:
        """What `stcalib_ros.io.assemble.assemble_recording` takes: a copy that stays as it is.

        Parameters
        ----------
        names : iterable of str
            Cameras to use; none: all.
        start_s, end_s : float
            First and last stamp to use, seconds, by the reference clock.
        clocks : mapping of str to ClockCorrection, optional
            From a camera's clock to the reference clock; they agree where this is unknown.

        Returns
        -------
        list of CameraImages
            Of the cameras that have images and a CameraInfo, in the order of the configuration.
        """
        wanted = frozenset(names)
        out = []
        with self._settled() as buffers:
            for name, buffer in buffers.items():
                clock = (clocks or {}).get(name, SAME_CLOCK)
                low, high = clock.camera_time(start_s), clock.camera_time(end_s)
                images = [i for i in buffer.images if low <= i.stamp_ns / NS <= high]
                if images and (info := buffer.info) is not None and (not wanted or name in wanted):
                    out.append(_camera_images(buffer.camera, images, info))
        return out

    def driver_images(self) -> dict[str, DriverImage]:
        """Which image the keypoints of every camera are in."""
        with self._settled() as buffers:
            return {name: buffer.driver_image for name, buffer in buffers.items()}

    @contextmanager
    def _settled(self) -> Iterator[Mapping[str, CameraBuffer]]:
        """All buffers, locked, with the changes that have proved to be some by now."""
        with self._lock:
            for buffer in self._buffers.values():
                buffer.settle()
            yield self._buffers


def _camera_images(
    camera: SelectedCamera, images: Sequence[PoseImage], info: CameraInfoFields
) -> CameraImages:
    return CameraImages(
        name=camera.name,
        images=images,
        info=info,
        pose_topic=camera.pose_topic,
        info_topic=camera.info_topic,
        frame_id=camera.frame,
        line_time_s=camera.line_time_s,
        settings=camera.lens,
    )
