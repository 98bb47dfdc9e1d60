"""What arrived of one camera, in bounded memory; knows no ROS."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np

from stcalib_ros.core.errors import InputError, one_line
from stcalib_ros.core.lifting.keypoint_checks import has_enough, keypoint_fault
from stcalib_ros.core.model.rejection import Rejection
from stcalib_ros.io.keypoint_pixels import with_pixels
from stcalib_ros.io.messages import NS, CameraInfoFields, PoseImage, lens, pose_image
from stcalib_ros.io.topics import SelectedCamera
from stcalib_ros.ros.buffer_warnings import ASIDE, FLUSH, RESTART
from stcalib_ros.ros.lens_follower import LensChange, LensFollower
from stcalib_ros.ros.lens_input import DriverImage
from stcalib_ros.ros.limits import MAX_CHECKED_IMAGES, MAX_LINE, MAX_TEXT
from stcalib_ros.ros.streams import Follower, Limits

Warn = Callable[[str, str], object]
"""Takes the subject of a warning, by which it is throttled, and the warning in one line."""

Clock = Callable[[], float]


@dataclass(frozen=True, slots=True)
class Counts:
    """State of one camera's buffer.

    Attributes
    ----------
    images, persons : int
        Number of them in the buffer.
    rate_hz : float
        Rate of the images in the buffer, by their stamps; NaN with fewer than two.
    age_s : float
        Time since the last pose message arrived; inf if none has.
    has_info : bool
        There is a CameraInfo, or the parameters give the size of the image.
    moving_s : int
        Seconds of the window in which somebody moves.
    received, dropped, flushes : int
        Since the start: pose messages, messages that were oversize, malformed or of another
        stream, and how often the buffer was emptied.
    last_problem : str
        Why the last message was dropped or the buffer emptied.
    set_aside : int
        Images that do not continue what came before, until it is clear what they are.
    no_keypoints : bool
        There are persons, but not a single keypoint of them was observed.
    images_3d : int
        Images in the buffer in which somebody has a 3D pose.
    fault : Rejection or None
        Why the keypoints cannot be those of people.
    dropped_age_s : float
        Time since the last message was dropped; inf if none was.
    no_lens : Rejection or None
        Why the camera cannot be calibrated by its CameraInfo.
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
    set_aside: int = 0
    no_keypoints: bool = False
    images_3d: int = 0
    fault: Rejection | None = None
    dropped_age_s: float = math.inf
    no_lens: Rejection | None = None


class CameraBuffer:
    """Images and CameraInfo of one camera; what others send on its topics does not empty it.

    Images are followed by a `stcalib_ros.ros.streams.Follower`, CameraInfo by a
    `stcalib_ros.ros.lens_follower.LensFollower`: images since it has changed are those of the new
    lens.

    Attributes
    ----------
    lens : LensFollower
    """

    def __init__(self, camera: SelectedCamera, limits: Limits, warn: Warn, clock: Clock) -> None:
        self.camera, self.limits = camera, limits
        self.lens = LensFollower(camera, clock)
        self._warn, self._clock = warn, clock
        self._follower = Follower(limits)
        self._arrived: float | None = None
        self._dropped_at_s = -math.inf
        self._received = self._dropped = self._flushes = 0
        self._last_problem = ""

    @property
    def info(self) -> CameraInfoFields | None:
        """What there is of the lens; None if not even the size of the image is known."""
        return self.lens.info

    @property
    def no_lens(self) -> Rejection | None:
        """Why the camera cannot be calibrated by what there is; None also if there is nothing."""
        return self.lens.missing(self.driver_image.rectified)

    @property
    def driver_image(self) -> DriverImage:
        """Which image the keypoints are in."""
        return DriverImage(self.lens.published, bool(self.images) and self.images[-1].rectified)

    @property
    def images(self) -> Sequence[PoseImage]:
        """Images of the window, in the order of their arrival."""
        return self._follower.stream.images

    @property
    def moving(self) -> set[int]:
        """Whole seconds, by the stamps, in which somebody moves."""
        return self._follower.stream.moving

    def add_poses(self, message: Any) -> None:
        """Take in a message with the fields of ``PersonPose3DArray``, if it is usable."""
        self._received += 1
        self._arrived = self._clock()
        try:
            _require_pose_bounds(message, self.limits)
            image = pose_image(message, topic=self.camera.pose_topic)
            if (image.project or image.fractions) and self.info is not None:
                topic = self.camera.info_topic
                given = lens(self.info, rectified=image.rectified, topic=topic)
                image = with_pixels(image, given, topic)
            if image.stamp_ns < 0:
                raise InputError(f"{self.camera.pose_topic}: the header stamp is negative")
        except (InputError, ValueError, TypeError) as error:
            self._drop(str(error))
            return
        self.settle()
        self._take(image, self._arrived)

    def heard(self) -> None:
        """Take note that the camera sends."""
        self._arrived = self._clock()

    def reject(self, why: str) -> None:
        """Count and report a message that cannot be read."""
        self._received += 1
        self._arrived = self._clock()
        self._drop(why)

    def add_info(self, message: Any) -> None:
        """Take in a message as ``CameraInfo``; a change empties the buffer.

        The pose messages say which image it is of, the raw or the rectified one; before the first
        of them, either will do.
        """
        rectified = (self.images[-1].rectified,) if self.images else (False, True)
        newest_ns = self.images[-1].stamp_ns if self.images else 0
        try:
            news = self.lens.take(message, rectified, newest_ns)
        except (InputError, ValueError, TypeError) as error:
            self._drop(str(error))
            return
        self._count_dropped(news.dropped)
        self._last_problem = news.problem or self._last_problem
        if news.waiting:
            self._warn("lens", news.waiting)
        self.settle()

    def set_limits(self, limits: Limits) -> None:
        """Change the bounds; what they do not allow any more is discarded."""
        self.limits = limits
        self._follower.set_limits(limits)

    def settle(self) -> None:
        """Take over a change that has proved to be one by now."""
        now_s = self._clock()
        before_ns = self._follower.stream.newest_ns
        if (change := self._follower.change(now_s)) is not None:
            why, dropped = change
            self._count_dropped(dropped)
            if why:
                back = self._follower.stream.newest_ns < before_ns
                self._flushed(f"{self.camera.pose_topic}: {why}", RESTART if back else FLUSH)
        if (new := self.lens.settle()) is not None:
            self._take_lens(new)

    def counts(self) -> Counts:
        """State for diagnostics."""
        n, persons = len(self.images), sum(len(image.track_ids) for image in self.images)
        stamps = [image.stamp_ns for image in self.images]
        span_s = (max(stamps) - min(stamps)) / NS if n else 0.0
        return Counts(
            images=n,
            persons=persons,
            rate_hz=(n - 1) / span_s if span_s > 0 else math.nan,
            age_s=math.inf if self._arrived is None else self._clock() - self._arrived,
            has_info=self.info is not None,
            moving_s=len(self.moving),
            received=self._received,
            dropped=self._dropped,
            flushes=self._flushes,
            last_problem=self._last_problem,
            set_aside=self._follower.n_aside,
            no_keypoints=persons > 0
            and not any(np.isfinite(i.keypoints).any() for i in self.images),
            images_3d=sum(image.joints is not None for image in self.images),
            fault=self._fault(),
            dropped_age_s=self._clock() - self._dropped_at_s,
            no_lens=self.no_lens,
        )

    def _fault(self) -> Rejection | None:
        """Return why the keypoints cannot be those of people, by some images of the window."""
        info = self.info
        if info is None or not self.images:
            return None
        stride = math.ceil(len(self.images) / MAX_CHECKED_IMAGES)
        some = list(islice(self.images, 0, None, stride))
        poses = np.concatenate([image.keypoints for image in some])
        scores = np.concatenate([image.joint_scores for image in some])
        poses = np.where((scores > 0)[..., None], poses, np.nan)
        return keypoint_fault(
            poses[has_enough(poses)],
            camera=self.camera.name,
            width=info.width,
            height=info.height,
        )

    def _take(self, image: PoseImage, now_s: float) -> None:
        topic = self.camera.pose_topic
        if why := self._follower.break_before(image):
            self._count_dropped(self._follower.set_aside(image, why))
            self._last_problem = one_line(
                f"{topic}: {why}; do two cameras publish on this topic?", MAX_LINE
            )
            self._warn(ASIDE, f"{self._last_problem} (images are set aside until this is clear)")
            return
        if bound := self._follower.append(image, now_s):
            self._warn("bound", f"{topic}: {bound}; the oldest images are discarded")
        if dropped := self._follower.drop_aside():
            self._count_dropped(dropped)
            self._warn(
                "dropped", f"{topic}: the {dropped} images that were set aside are discarded"
            )

    def _take_lens(self, change: LensChange) -> None:
        if change.until_ns is None:
            self._warn("lens", change.why)
            return
        had_images = bool(self.images)
        self._follower.forget(change.until_ns)
        if had_images:
            self._flushed(change.why)

    def _flushed(self, why: str, event: str = FLUSH) -> None:
        self._flushes += 1
        self._last_problem = one_line(why, MAX_LINE)
        self._warn(event, f"{self._last_problem}; images received before are discarded")

    def _count_dropped(self, n: int) -> None:
        if n:
            self._dropped += n
            self._dropped_at_s = self._clock()

    def _drop(self, why: str) -> None:
        self._count_dropped(1)
        self._last_problem = one_line(why, MAX_LINE)
        self._warn("drop", f"{self._last_problem} (dropped)")


def _require_pose_bounds(message: Any, limits: Limits) -> None:
    if len(message.persons) > limits.max_persons:
        raise InputError(
            f"{len(message.persons)} persons in one image; {limits.max_persons} are accepted "
            "(max_persons)"
        )
    if len(message.joint_names) > limits.max_joints:
        raise InputError(f"more than {limits.max_joints} joint names")
    for name in (message.layout, message.header.frame_id, *message.joint_names):
        if len(name) > MAX_TEXT or not name.isprintable():
            raise InputError(
                f"layout, frame_id and joint names have at most {MAX_TEXT} characters that can be "
                f"printed, got {name[:MAX_TEXT]!r}"
            )
    for person in message.persons:
        sizes = (len(person.joints) / 3, len(person.keypoints) / 2, len(person.joint_scores))
        if max(sizes) > limits.max_joints:
            raise InputError(
                f"a person of {max(sizes):.0f} joints; {limits.max_joints} are accepted "
                "(max_joints)"
            )
