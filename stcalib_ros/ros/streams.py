"""Images of one topic that belong together, and a change that is real; knows no ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.io.messages import NS, PoseImage, format_stamp

MAX_TEXT = 256
"""Characters of a name in a message."""

QUIET_S = 1.0
"""Nothing may have come of a stream for so long, by the wall clock, before another replaces it."""

CONFIRMING = 10
"""So many images must continue each other before they replace what is there."""

_NEAR_NS = NS
_WITHIN_NS = 10 * NS
_ASIDE = 3
_IMAGE_BYTES = 1000
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
    max_mb : float
        Memory of them, per camera, megabytes.
    max_persons, max_joints : int
        Of one message; a larger one is dropped.
    """

    window_s: float = 30.0
    max_images: int = 6000
    max_mb: float = 100.0
    max_persons: int = 50
    max_joints: int = 150

    @property
    def max_bytes(self) -> int:
        """Longest message that can be within the bounds: one that is longer need not be decoded."""
        return (
            1000
            + (self.max_joints + 2) * 2 * MAX_TEXT
            + self.max_persons * (100 + 24 * self.max_joints)
        )


class Stream:
    """Images of one camera that continue each other, with the motion in them.

    Parameters
    ----------
    limits : Limits
        May be exchanged; `trim` then forgets what they no longer allow.

    Attributes
    ----------
    images : deque of PoseImage
        In the order of their arrival.
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

    def break_before(self, image: PoseImage, *, ahead_ns: int = _NEAR_NS) -> str:
        """Why an image does not continue this stream; empty if it does."""
        if not self.images:
            return ""
        if field := _difference(self.images[-1], image):
            before, after = (_text(getattr(i, field)) for i in (self.images[-1], image))
            return f"{field} changes from {before} to {after}"
        ahead = image.stamp_ns - self.newest_ns
        if -_NEAR_NS <= ahead <= ahead_ns:
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

    def offness(self, image: PoseImage) -> tuple[bool, int]:
        """How closely an image follows, for comparison: those behind are farther than any ahead."""
        ahead_ns = image.stamp_ns - self.newest_ns
        return ahead_ns <= 0, abs(ahead_ns)

    def append(self, image: PoseImage) -> str:
        """Add an image; returns which bound other than the window made it forget others."""
        self.newest_ns = max(image.stamp_ns, self.newest_ns) if self.images else image.stamp_ns
        self.images.append(image)
        self._bytes += _size(image)
        self._look_for_motion(image)
        return self.trim() if self._oldest_goes() else ""

    def trim(self) -> str:
        """Forget what the limits do not allow; returns which other than the window."""
        bound = ""
        while self._oldest_goes():
            bound = self._exceeded() or bound
            self._bytes -= _size(self.images.popleft())
        first = self.images[0].stamp_ns // NS if self.images else 0
        self.moving = {second for second in self.moving if second >= first}
        return bound

    def after(self, stamp_ns: int) -> Stream:
        """Copy with the images later than a stamp only."""
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
        """Compare with half a second ago; a longer gap tells nothing."""
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
    dropped. If `CONFIRMING` images that continue each other were set aside and nothing has come of
    the stream for `QUIET_S`, the camera has changed: they are the stream from then on, and none of
    them is lost. After a mere gap they are added to what is there. No single message, then,
    empties a buffer, and neither does somebody else while the camera is sending. Whoever sends
    what the camera could have sent is not told from it; for that there is SROS 2.

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
        """Change the bounds; what they no longer allow is forgotten."""
        self.stream.limits = limits
        self.stream.trim()
        for aside in self._aside:
            aside.stream.limits = _share(limits)
            aside.stream.trim()

    def break_before(self, image: PoseImage) -> str:
        """Why an image does not continue the stream; empty if it does.

        One that continues what was set aside at least as closely - a short bag that is played
        again gets to where it had ended - does not.
        """
        if why := self.stream.break_before(image):
            return why
        aside = self._closest_aside(image, ahead_ns=_NEAR_NS)
        closer = aside is not None and aside.stream.offness(image) <= self.stream.offness(image)
        return aside.why if aside is not None and closer else ""

    def append(self, image: PoseImage, now_s: float) -> str:
        """Add an image that continues the stream; returns what `Stream.append` does."""
        self._heard_s = now_s
        return self.stream.append(image)

    def set_aside(self, image: PoseImage, why: str) -> int:
        """Keep an image for the case that the camera has changed; returns how many went for it."""
        if (aside := self._closest_aside(image, ahead_ns=_WITHIN_NS)) is not None:
            before = len(aside.stream.images)
            aside.stream.append(image)
            return before + 1 - len(aside.stream.images)
        dropped = 0
        if len(self._aside) == _ASIDE:
            least = min(self._aside, key=lambda aside: len(aside.stream.images))
            self._aside.remove(least)
            dropped = len(least.stream.images)
        self._aside.append(_Aside(Stream(_share(self.stream.limits), [image]), why))
        return dropped

    def drop_aside(self) -> int:
        """Forget what was set aside; returns how many images these were."""
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
        if len(best.stream.images) < CONFIRMING:
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
        """What an image continues of all that was set aside."""
        continued = [a for a in self._aside if not a.stream.break_before(image, ahead_ns=ahead_ns)]
        return min(continued, key=lambda aside: aside.stream.offness(image), default=None)

    def forget(self, until_ns: int) -> None:
        """Forget the images up to a stamp."""
        self.stream = self.stream.after(until_ns)


def _share(limits: Limits) -> Limits:
    return replace(limits, max_images=limits.max_images // _ASIDE, max_mb=limits.max_mb / _ASIDE)


def _size(image: PoseImage) -> int:
    arrays = (image.track_ids, image.scores, image.keypoints, image.joints, image.joint_scores)
    return _IMAGE_BYTES + sum(array.nbytes for array in arrays)


def _text(value: Layout | bool | str) -> str:
    return repr(value.name if isinstance(value, Layout) else value)


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
