"""What arrived of each camera, in bounded memory; knows no ROS."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.assemble import CameraImages
from stcalib_ros.io.messages import (
    NS,
    CameraInfoFields,
    PoseImage,
    camera_info_fields,
    format_stamp,
    lens,
    pose_image,
)
from stcalib_ros.io.topics import SelectedCamera

Say = Callable[[str], None]

_BACKWARDS_NS = NS
_MAX_TEXT = 256
_SAMPLE_NS = NS // 2
_SAMPLE_GAP_NS = 3 * NS // 2
_MOVING_BODIES = 0.05
"""Displacement of key points in half a second that counts as moving, as a share of the height."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds on what is kept and accepted.

    Attributes
    ----------
    window_s : float
        Images older than this before the newest of their camera are forgotten.
    max_images : int
        Per camera, whatever the window.
    max_persons, max_joints : int
        Of one message; a larger one is dropped.
    """

    window_s: float = 30.0
    max_images: int = 6000
    max_persons: int = 50
    max_joints: int = 150


@dataclass(frozen=True, slots=True)
class Counts:
    """State of one camera's buffer.

    Attributes
    ----------
    images, persons : int
        In the buffer.
    rate_hz : float
        Of the images in the buffer, by their stamps; NaN with fewer than two.
    age_s : float
        Since the last pose message arrived; inf if none has.
    has_info : bool
    moving_s : int
        Seconds of the window in which somebody moves.
    received, dropped, flushes : int
        Since the start: pose messages, messages that were oversize or malformed, and how often the
        buffer was emptied.
    last_problem : str
        Why the last message was dropped or the buffer emptied.
    """

    images: int
    persons: int
    rate_hz: float
    age_s: float
    has_info: bool
    moving_s: int
    received: int
    dropped: int
    flushes: int
    last_problem: str


class CameraBuffer:
    """Images and lens of one camera."""

    def __init__(self, camera: SelectedCamera, limits: Limits, say: Say) -> None:
        self.camera, self.limits = camera, limits
        self.info: CameraInfoFields | None = None
        self.images: deque[PoseImage] = deque()
        self.moving: set[int] = set()
        self._say = say
        self._sample: PoseImage | None = None
        self._newest_ns = 0
        self._arrived: float | None = None
        self._received = self._dropped = self._flushes = 0
        self._last_problem = ""

    def add_poses(self, message: Any) -> None:
        """Take in a ``PersonPose3DArray``; an unusable one is counted, said and dropped."""
        self._received += 1
        self._arrived = time.monotonic()
        try:
            _require_pose_bounds(message, self.limits)
            image = pose_image(message, topic=self.camera.pose_topic)
            if image.stamp_ns < 0:
                raise InputError(f"{self.camera.pose_topic}: the header stamp is negative")
        except (InputError, ValueError, TypeError) as error:
            self._drop(str(error))
            return
        self._take(image)

    def reject(self, why: str) -> None:
        """Count, say and drop a message that cannot be read."""
        self._received += 1
        self._drop(why)

    def add_info(self, message: Any) -> None:
        """Take in a ``CameraInfo``; a new lens empties the buffer."""
        topic = self.camera.info_topic
        try:
            _require_info_bounds(message, topic)
            info = camera_info_fields(message)
            lens(info, rectified=False, topic=topic)
        except (InputError, ValueError, TypeError) as error:
            self._drop(str(error))
            return
        if self.info is not None and info != self.info:
            field = next(f for f in info._fields if getattr(self.info, f) != getattr(info, f))
            self._flush(
                f"{topic}: CameraInfo changes: {field} was {getattr(self.info, field)} and is "
                f"{getattr(info, field)}"
            )
        self.info = info

    def trim(self) -> None:
        """Forget what the limits do not allow."""
        oldest_ns = self._newest_ns - round(self.limits.window_s * NS)
        while self.images and self.images[0].stamp_ns < oldest_ns:
            self.images.popleft()
        if len(self.images) > self.limits.max_images:
            self._say(
                f"{self.camera.pose_topic}: more than {self.limits.max_images} images within "
                f"{self.limits.window_s:g} s; the oldest are forgotten (max_images)"
            )
            while len(self.images) > self.limits.max_images:
                self.images.popleft()
        first = self.images[0].stamp_ns // NS if self.images else 0
        self.moving = {second for second in self.moving if second >= first}

    def counts(self) -> Counts:
        """State for diagnostics."""
        n = len(self.images)
        stamps = [image.stamp_ns for image in self.images]
        span_s = (max(stamps) - min(stamps)) / NS if n else 0.0
        return Counts(
            images=n,
            persons=sum(len(image.track_ids) for image in self.images),
            rate_hz=(n - 1) / span_s if span_s > 0 else math.nan,
            age_s=math.inf if self._arrived is None else time.monotonic() - self._arrived,
            has_info=self.info is not None,
            moving_s=len(self.moving),
            received=self._received,
            dropped=self._dropped,
            flushes=self._flushes,
            last_problem=self._last_problem,
        )

    def _take(self, image: PoseImage) -> None:
        if self.images and image.stamp_ns < self._newest_ns - _BACKWARDS_NS:
            self._flush(
                f"{self.camera.pose_topic}: time jumps back from {format_stamp(self._newest_ns)} "
                f"to {format_stamp(image.stamp_ns)}"
            )
        elif self.images and (field := _difference(self.images[-1], image)):
            self._flush(
                f"{self.camera.pose_topic}: {field} changes; do two cameras publish on this topic?"
            )
        self._newest_ns = max(image.stamp_ns, self._newest_ns) if self.images else image.stamp_ns
        self.images.append(image)
        self._look_for_motion(image)
        if self._over():
            self.trim()

    def _over(self) -> bool:
        oldest_ns = self._newest_ns - round(self.limits.window_s * NS)
        return self.images[0].stamp_ns < oldest_ns or len(self.images) > self.limits.max_images

    def _look_for_motion(self, image: PoseImage) -> None:
        """Compare with half a second ago; a longer gap tells nothing."""
        sample = self._sample
        if sample is not None:
            gap_ns = image.stamp_ns - sample.stamp_ns
            if 0 <= gap_ns < _SAMPLE_NS:
                return
            if 0 < gap_ns < _SAMPLE_GAP_NS and _somebody_moves(sample, image):
                self.moving.add(image.stamp_ns // NS)
        self._sample = image

    def _flush(self, why: str) -> None:
        self._flushes += 1
        self._last_problem = why
        self._say(f"{why}; what was received before is forgotten")
        self.images.clear()
        self.moving.clear()
        self._sample = None

    def _drop(self, why: str) -> None:
        self._dropped += 1
        self._last_problem = why
        self._say(f"{why} (dropped)")


class Buffers:
    """Buffers of all cameras; may be used from several threads.

    Parameters
    ----------
    cameras : sequence of SelectedCamera
    limits : Limits
    say : callable
        Told the camera's name and, in one line, what was dropped or forgotten and why.
    """

    def __init__(
        self,
        cameras: Sequence[SelectedCamera],
        limits: Limits,
        say: Callable[[str, str], None],
    ) -> None:
        self._lock = threading.Lock()
        self._buffers = {
            c.name: CameraBuffer(c, limits, lambda line, name=c.name: say(name, line))  # type: ignore[misc]
            for c in cameras
        }

    def add_poses(self, name: str, message: Any) -> None:
        """Take in a ``PersonPose3DArray`` of a camera."""
        with self._lock:
            self._buffers[name].add_poses(message)

    def add_info(self, name: str, message: Any) -> None:
        """Take in a ``CameraInfo`` of a camera."""
        with self._lock:
            self._buffers[name].add_info(message)

    def reject(self, name: str, why: str) -> None:
        """Count, say and drop a message of a camera that cannot be read at all."""
        with self._lock:
            self._buffers[name].reject(why)

    def set_limits(self, limits: Limits) -> None:
        """Change the bounds; what they no longer allow is forgotten."""
        with self._lock:
            for buffer in self._buffers.values():
                buffer.limits = limits
                buffer.trim()

    def counts(self) -> dict[str, Counts]:
        """State of every camera."""
        with self._lock:
            return {name: buffer.counts() for name, buffer in self._buffers.items()}

    def newest_s(self) -> float:
        """Latest stamp of all images, seconds; NaN if there is none."""
        with self._lock:
            stamps = [b.images[-1].stamp_ns for b in self._buffers.values() if b.images]
        return max(stamps) / NS if stamps else math.nan

    def moving(self) -> dict[str, frozenset[int]]:
        """Whole seconds, by the stamps of each camera with a lens, in which somebody moves."""
        with self._lock:
            return {n: frozenset(b.moving) for n, b in self._buffers.items() if b.info is not None}

    def snapshot(
        self,
        names: Iterable[str] = (),
        *,
        start_s: float = -math.inf,
        end_s: float = math.inf,
        offsets_s: Mapping[str, float] | None = None,
    ) -> list[CameraImages]:
        """What `stcalib_ros.io.assemble.assemble_recording` takes: a copy that stays as it is.

        Parameters
        ----------
        names : iterable of str
            Cameras to use; none: all.
        start_s, end_s : float
            First and last stamp to use, seconds, by the reference clock.
        offsets_s : mapping of str to float, optional
            What to add to a camera's stamps to have the reference clock; 0 where it is unknown.

        Returns
        -------
        list of CameraImages
            Of the cameras that have images and a lens, in the order of the configuration.
        """
        wanted, offsets = frozenset(names), offsets_s or {}
        out = []
        with self._lock:
            for name, buffer in self._buffers.items():
                low, high = start_s - offsets.get(name, 0.0), end_s - offsets.get(name, 0.0)
                images = [i for i in buffer.images if low <= i.stamp_ns / NS <= high]
                if images and buffer.info is not None and (not wanted or name in wanted):
                    out.append(_camera_images(buffer.camera, images, buffer.info))
        return out


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
    )


def _require_pose_bounds(message: Any, limits: Limits) -> None:
    if len(message.persons) > limits.max_persons:
        raise InputError(
            f"{len(message.persons)} persons in one image; {limits.max_persons} are accepted "
            "(max_persons)"
        )
    if max(len(message.layout), len(message.header.frame_id)) > _MAX_TEXT:
        raise InputError(f"layout or frame_id is longer than {_MAX_TEXT} characters")
    names = message.joint_names
    if len(names) > limits.max_joints or any(len(name) > _MAX_TEXT for name in names):
        raise InputError(f"more than {limits.max_joints} joint names, or too long ones")
    for person in message.persons:
        sizes = (len(person.joints) / 3, len(person.keypoints) / 2, len(person.joint_scores))
        if max(sizes) > limits.max_joints:
            raise InputError(
                f"a person of {max(sizes):.0f} joints; {limits.max_joints} are accepted "
                "(max_joints)"
            )


def _require_info_bounds(message: Any, topic: str) -> None:
    if max(len(message.d), len(message.distortion_model)) > _MAX_TEXT:
        raise InputError(f"{topic}: oversize CameraInfo")
    numbers = np.concatenate([np.asarray(getattr(message, f), dtype=float) for f in "dkrp"])
    if not np.isfinite(numbers).all():
        raise InputError(f"{topic}: CameraInfo has numbers that are not finite")


def _difference(before: PoseImage, after: PoseImage) -> str:
    """First field that must not change and does; empty if there is none."""
    for field in ("layout", "rectified", "metric", "frame_id"):
        if getattr(before, field) != getattr(after, field):
            return field
    return ""


def _somebody_moves(before: PoseImage, after: PoseImage) -> bool:
    """Whether the key points of any track are displaced by more than noise."""
    _, rows, others = np.intersect1d(before.track_ids, after.track_ids, return_indices=True)
    for a, b in zip(before.keypoints[rows], after.keypoints[others], strict=True):
        seen = np.isfinite(a).all(-1) & np.isfinite(b).all(-1)
        if seen.sum() < 3:
            continue
        height = float(np.ptp(b[seen, 1]))
        displacement = float(np.median(np.linalg.norm(b[seen] - a[seen], axis=-1)))
        if displacement > _MOVING_BODIES * max(height, 1.0):
            return True
    return False
