"""Images of one topic that continue each other, and when the camera has changed; knows no ROS."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.io.messages import NS, Float32Array, PoseImage, format_stamp
from stcalib_ros.ros.limits import (
    CONFIRMING_IMAGES,
    MAX_ASIDE_STEP_S,
    MAX_ASIDE_STREAMS,
    MAX_SAMPLE_GAP_S,
    MAX_STAMP_STEP_S,
    MAX_TEXT,
    MIN_MOTION,
    MIN_MOVING_JOINTS,
    QUIET_S,
    SAMPLE_S,
)

_STEP_NS = round(MAX_STAMP_STEP_S * NS)
_ASIDE_STEP_NS = round(MAX_ASIDE_STEP_S * NS)
_SAMPLE_NS = round(SAMPLE_S * NS)
_SAMPLE_GAP_NS = round(MAX_SAMPLE_GAP_S * NS)
_IMAGE_BYTES = 1000
"""Bytes. Memory of an image besides the numbers in its arrays: their objects and the record."""
_MESSAGE_BYTES, _PERSON_BYTES, _JOINT_BYTES = 1000, 100, 24
"""Bytes. What a message takes besides names, a person besides joints, and a joint (six float32);
rounded up, since a message that is too long is not decoded."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds on what is kept and accepted.

    Attributes
    ----------
    window_s : float
        Images older than this before the newest of their camera are discarded.
    max_images : int
        Number of images per camera, whatever the window.
    max_mb : float
        Memory of the images per camera, megabytes.
    max_persons, max_joints : int
        Persons of a message, and joints of a person; a larger message is dropped.
    """

    window_s: float = 30.0
    max_images: int = 6000
    max_mb: float = 100.0
    max_persons: int = 50
    max_joints: int = 150

    @property
    def max_bytes(self) -> int:
        """Length of the longest message within the bounds; a longer one is not decoded."""
        return (
            _MESSAGE_BYTES
            + (self.max_joints + 2) * 2 * MAX_TEXT
            + self.max_persons * (_PERSON_BYTES + _JOINT_BYTES * self.max_joints)
        )


class Stream:
    """Images of one camera that continue each other, with the motion in them.

    Parameters
    ----------
    limits : Limits
        May be replaced; `trim` then discards what they do not allow any more.

    Attributes
    ----------
    images : deque of PoseImage
        Images in the order of their arrival.
    moving : set of int
        Whole seconds, by the stamps, in which somebody moves.
    newest_ns : int
        Latest stamp; 0 if there is no image.
    """

    def __init__(self, limits: Limits, images: Iterable[PoseImage] = ()) -> None:
        self.limits = limits
        self.images: deque[PoseImage] = deque()
        self.moving: set[int] = set()
        self.newest_ns = 0
        self._bytes = 0
        self._sample: PoseImage | None = None
        for image in images:
            self.append(image)

    def break_before(self, image: PoseImage, *, ahead_ns: int = _STEP_NS) -> str:
        """Why an image does not continue this stream; empty if it does."""
        if not self.images:
            return ""
        if field := _difference(self.images[-1], image):
            before, after = (_text(getattr(i, field)) for i in (self.images[-1], image))
            return f"{field} changes from {before} to {after}"
        ahead = image.stamp_ns - self.newest_ns
        if -_STEP_NS <= ahead <= ahead_ns:
            return ""
        return (
            f"time jumps {'ahead' if ahead > 0 else 'back'} from {format_stamp(self.newest_ns)} "
            f"to {format_stamp(image.stamp_ns)}"
        )

    def follows(self, other: Stream) -> bool:
        """Whether this is the same stream after a gap."""
        if not other.images:
            return False
        first = self.images[0]
        return not _difference(other.images[-1], first) and first.stamp_ns > other.newest_ns

    def distance(self, image: PoseImage) -> tuple[bool, int]:
        """Return how closely an image follows, for comparison: behind is farther than any ahead."""
        ahead_ns = image.stamp_ns - self.newest_ns
        return ahead_ns <= 0, abs(ahead_ns)

    def append(self, image: PoseImage) -> str:
        """Add an image; return which bound other than the window made it discard others."""
        self.newest_ns = max(image.stamp_ns, self.newest_ns) if self.images else image.stamp_ns
        self.images.append(image)
        self._bytes += _size(image)
        self._look_for_motion(image)
        return self.trim() if self._oldest_goes() else ""

    def trim(self) -> str:
        """Discard what the limits do not allow; return which of them other than the window."""
        bound = ""
        while self._oldest_goes():
            bound = self._exceeded() or bound
            self._bytes -= _size(self.images.popleft())
        first = self.images[0].stamp_ns // NS if self.images else 0
        self.moving = {second for second in self.moving if second >= first}
        return bound

    def after(self, stamp_ns: int) -> Stream:
        """Return a copy with the images later than a stamp only."""
        return Stream(self.limits, [i for i in self.images if i.stamp_ns > stamp_ns])

    def _oldest_goes(self) -> bool:
        if len(self.images) < 2:
            return False
        oldest_ns = self.newest_ns - round(self.limits.window_s * NS)
        return self.images[0].stamp_ns < oldest_ns or bool(self._exceeded())

    def _exceeded(self) -> str:
        if len(self.images) > self.limits.max_images:
            return f"more than {self.limits.max_images} images (max_images)"
        if self._bytes > self.limits.max_mb * 1e6:
            return f"more than {self.limits.max_mb:g} MB (max_mb)"
        return ""

    def _look_for_motion(self, image: PoseImage) -> None:
        """Compare an image with one of `SAMPLE_S` ago; nothing is known of a longer gap."""
        sample = self._sample
        if sample is not None:
            gap_ns = image.stamp_ns - sample.stamp_ns
            if 0 <= gap_ns < _SAMPLE_NS:
                return
            if 0 < gap_ns < _SAMPLE_GAP_NS and _somebody_moves(sample, image):
                self.moving.add(image.stamp_ns // NS)
        self._sample = image


@dataclass(slots=True, eq=False)
class _Aside:
    """Images that do not continue the stream, and why the first of them did not."""

    stream: Stream
    why: str


class Follower:
    """Follows what a camera sends on a topic on which others may publish, too.

    An image that does not continue the stream - another layout, frame, ``rectified`` or ``metric``,
    or a stamp more than a second away - is set aside. If the stream goes on, what was set aside is
    dropped. If `CONFIRMING_IMAGES` images that continue each other were set aside and nothing has
    come of the stream for `QUIET_S`, the camera has changed: they are the stream from then on, and
    none of them is lost. After a mere gap they are added to what is there. No single message,
    then, empties a buffer, and neither does somebody else while the camera is sending. Somebody
    who sends what the camera could have sent is not recognized; for that there is SROS 2.

    What is set aside takes at most as much memory as the stream.

    Parameters
    ----------
    limits : Limits
    """

    def __init__(self, limits: Limits) -> None:
        self.stream = Stream(limits)
        self._aside: list[_Aside] = []
        self._heard_s = 0.0

    @property
    def n_aside(self) -> int:
        """Images that are set aside."""
        return sum(len(aside.stream.images) for aside in self._aside)

    def set_limits(self, limits: Limits) -> None:
        """Change the bounds; what they do not allow any more is discarded."""
        self.stream.limits = limits
        self.stream.trim()
        for aside in self._aside:
            aside.stream.limits = _limits_aside(limits)
            aside.stream.trim()

    def break_before(self, image: PoseImage) -> str:
        """Why an image does not continue the stream; empty if it does.

        One that continues what was set aside at least as closely - a short bag that is played
        again gets to where it had ended - does not.
        """
        if why := self.stream.break_before(image):
            return why
        aside = self._closest_aside(image, ahead_ns=_STEP_NS)
        closer = aside is not None and aside.stream.distance(image) <= self.stream.distance(image)
        return aside.why if aside is not None and closer else ""

    def append(self, image: PoseImage, now_s: float) -> str:
        """Add an image that continues the stream; return what `Stream.append` does."""
        self._heard_s = now_s
        return self.stream.append(image)

    def set_aside(self, image: PoseImage, why: str) -> int:
        """Keep an image in case the camera has changed; return how many are dropped for it."""
        if (aside := self._closest_aside(image, ahead_ns=_ASIDE_STEP_NS)) is not None:
            before = len(aside.stream.images)
            aside.stream.append(image)
            return before + 1 - len(aside.stream.images)
        dropped = 0
        if len(self._aside) == MAX_ASIDE_STREAMS:
            least = min(self._aside, key=lambda aside: len(aside.stream.images))
            self._aside.remove(least)
            dropped = len(least.stream.images)
        self._aside.append(_Aside(Stream(_limits_aside(self.stream.limits), [image]), why))
        return dropped

    def drop_aside(self) -> int:
        """Drop what was set aside; return how many images these were."""
        dropped, self._aside = self.n_aside, []
        return dropped

    def change(self, now_s: float) -> tuple[str, int] | None:
        """Take over what was set aside if it has proved to be the camera.

        Returns
        -------
        tuple of str and int, or None
            What has changed - empty after a gap that left the window as it is - and how many
            images that were set aside are dropped. None: no change.
        """
        if not self._aside or now_s - self._heard_s < QUIET_S:
            return None
        best = max(self._aside, key=lambda aside: len(aside.stream.images))
        if len(best.stream.images) < CONFIRMING_IMAGES:
            return None
        self._aside.remove(best)
        self._heard_s = now_s
        why, limits = best.why, self.stream.limits
        if best.stream.follows(self.stream):
            before_ns = self.stream.newest_ns
            for image in best.stream.images:
                self.stream.append(image)
            if self.stream.images[0].stamp_ns <= before_ns:
                why = ""
        else:
            self.stream = Stream(limits, best.stream.images)
        return why, self.drop_aside()

    def _closest_aside(self, image: PoseImage, *, ahead_ns: int) -> _Aside | None:
        """Return what an image continues of all that was set aside."""
        continued = [a for a in self._aside if not a.stream.break_before(image, ahead_ns=ahead_ns)]
        return min(continued, key=lambda aside: aside.stream.distance(image), default=None)

    def forget(self, until_ns: int) -> None:
        """Discard the images up to a stamp."""
        self.stream = self.stream.after(until_ns)


def _limits_aside(limits: Limits) -> Limits:
    """Limits of one stream that is set aside: together they may take as much as the camera's."""
    return replace(
        limits,
        max_images=limits.max_images // MAX_ASIDE_STREAMS,
        max_mb=limits.max_mb / MAX_ASIDE_STREAMS,
    )


def _size(image: PoseImage) -> int:
    arrays = (image.track_ids, image.scores, image.keypoints, image.joints, image.joint_scores)
    return _IMAGE_BYTES + sum(array.nbytes for array in arrays if array is not None)


def _text(value: Layout | bool | str) -> str:
    return repr(value.name if isinstance(value, Layout) else value)


def _difference(before: PoseImage, after: PoseImage) -> str:
    """First field that must not change and does; empty if there is none."""
    for field in ("layout", "rectified", "metric", "frame_id"):
        if getattr(before, field) != getattr(after, field):
            return field
    return ""


def _somebody_moves(before: PoseImage, after: PoseImage) -> bool:
    """Whether the keypoints of any track are displaced by more than noise.

    Where no id is in both images, nobody tracks people; then a person is the nearest of before.
    """
    _, rows, others = np.intersect1d(before.track_ids, after.track_ids, return_indices=True)
    pairs = zip(before.keypoints[rows], after.keypoints[others], strict=True)
    moved = [_displacement(a, b) for a, b in pairs]
    if not len(rows) and len(before.keypoints):
        moved = [min(_displacement(a, b) for a in before.keypoints) for b in after.keypoints]
    return any(MIN_MOTION < one < math.inf for one in moved)


def _displacement(a: Float32Array, b: Float32Array) -> float:
    """Median displacement of the keypoints of a person, body heights; infinite where unknown."""
    observed = np.isfinite(a).all(-1) & np.isfinite(b).all(-1)
    if observed.sum() < MIN_MOVING_JOINTS:
        return math.inf
    height = max(float(np.ptp(b[observed, 1])), 1.0)
    return float(np.median(np.linalg.norm(b[observed] - a[observed], axis=-1))) / height
