"""The CameraInfo of one camera; what others send on its topic does not replace it. Knows no ROS."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.rejection import Rejection
from stcalib_ros.core.model.rejection_text import sentence
from stcalib_ros.io.lens_settings import info_with_size
from stcalib_ros.io.messages import CameraInfoFields, camera_info_fields
from stcalib_ros.io.topics import SelectedCamera
from stcalib_ros.ros.lens_input import (
    image_alone,
    knowledge_of,
    lens_change,
    lens_problem,
    missing_lens,
    require_info_bounds,
)
from stcalib_ros.ros.limits import LENS_QUIET_S, MAX_OTHER_LENSES


@dataclass(slots=True)
class _OtherLens:
    """A CameraInfo that differs from the one in force.

    Attributes
    ----------
    since_s : float
        When it was first received.
    newest_ns : int
        Newest stamp of the images then.
    n : int
        How often it was received.
    """

    since_s: float
    newest_ns: int
    n: int = 0


class LensNews(NamedTuple):
    """What came of a CameraInfo.

    Attributes
    ----------
    waiting : str
        What would change if it lasted; empty: nothing.
    dropped : int
        CameraInfos that are dropped for good.
    problem : str
        Why; empty: none is.
    """

    waiting: str = ""
    dropped: int = 0
    problem: str = ""


class LensChange(NamedTuple):
    """Another CameraInfo is in force.

    Attributes
    ----------
    why : str
    until_ns : int or None
        Newest stamp of the images that are not of it; None: all of them are.
    """

    why: str
    until_ns: int | None


class LensFollower:
    """Follows the CameraInfo of one camera.

    Another one than the one in force counts when the latter has not come for `LENS_QUIET_S`: a
    driver that was configured anew repeats its new one, or has latched it. Of a lens that is
    estimated, only the image counts: a driver that takes over what was found changes nothing.

    Parameters
    ----------
    camera : SelectedCamera
    clock : callable
        Steady, seconds.

    Attributes
    ----------
    default : LensKnowledge
        What the CameraInfo is worth, if the camera's parameters do not say.
    """

    def __init__(self, camera: SelectedCamera, clock: Callable[[], float]) -> None:
        self.default = LensKnowledge.GIVEN
        self._camera, self._clock = camera, clock
        self._published: CameraInfoFields | None = None
        self._others: dict[CameraInfoFields, _OtherLens] = {}

    @property
    def published(self) -> CameraInfoFields | None:
        """What the driver says, with the size of the image where parameters give it."""
        return info_with_size(self._published, self._camera.lens, self._camera.info_topic)

    @property
    def info(self) -> CameraInfoFields | None:
        """What there is to calibrate with; None if not even the size of the image is known."""
        info = self.published
        return None if info is None else self._used(info)

    def missing(self, rectified: bool) -> Rejection | None:
        """Why keypoints of that image need a lens that is not there; None also if nothing is."""
        return None if (info := self.info) is None else self._missing(info, rectified)

    def take(self, message: Any, rectified: Iterable[bool], newest_ns: int) -> LensNews:
        """Take in a message as ``CameraInfo``.

        Parameters
        ----------
        message : object
            With the fields of ``sensor_msgs/CameraInfo``.
        rectified : iterable of bool
            Whether the keypoints are those of the rectified image; both if that is not known.
        newest_ns : int
            Newest stamp of the images so far.

        Raises
        ------
        InputError
            It cannot be used.
        """
        require_info_bounds(message, self._camera.info_topic)
        info = camera_info_fields(message)
        self._require_usable(info, tuple(rectified))
        if not self._continues(info, tuple(rectified)):
            return self._note_other(info, newest_ns)
        self._published = info
        self._others.pop(info, None)
        if not self._others:
            return LensNews()
        n, other = len(self._others), next(iter(self._others))
        self._others.clear()
        return LensNews(dropped=n, problem=lens_change(self._camera.info_topic, info, other))

    def settle(self) -> LensChange | None:
        """Take over another one that has proved to be the camera's by now."""
        if not self._others:
            return None
        info = max(self._others, key=lambda i: (self._others[i].n, self._others[i].since_s))
        other, before = self._others[info], self._published
        if self._clock() - other.since_s < LENS_QUIET_S:
            return None
        self._published, self._others = info, {}
        why = lens_change(self._camera.info_topic, before, info)
        estimated = self._knowledge is not LensKnowledge.GIVEN
        if estimated and before is not None and image_alone(before) == image_alone(info):
            return LensChange(f"{why}; it is refined from the new values", None)
        return LensChange(why, other.newest_ns)

    @property
    def _knowledge(self) -> LensKnowledge:
        return knowledge_of(self._camera.lens, self.default)

    def _used(self, info: CameraInfoFields) -> CameraInfoFields:
        """Return what of a CameraInfo is used."""
        return image_alone(info) if self._knowledge is LensKnowledge.UNKNOWN else info

    def _missing(self, info: CameraInfoFields, rectified: bool) -> Rejection | None:
        name, settings = self._camera.name, self._camera.lens
        return missing_lens(name, info, settings, self._knowledge, rectified=rectified)

    def _require_usable(self, info: CameraInfoFields, rectified: tuple[bool, ...]) -> None:
        """Demand what can describe one of those images, with a lens if there is one already."""
        topic = self._camera.info_topic
        used = self._used(info_with_size(info, self._camera.lens, topic) or info)
        problems = [lens_problem(used, one, topic) for one in rectified]
        if all(problems):
            raise InputError(problems[0])
        if self._published is not None and self.missing(rectified[0]) is None:
            lacking = [self._missing(used, one) for one in rectified]
            if lacking[0] is not None and all(lacking):
                raise InputError(f"{topic}: {sentence(lacking[0])}")

    def _continues(self, info: CameraInfoFields, rectified: tuple[bool, ...]) -> bool:
        """Whether a CameraInfo is the first one, the same, or has the lens that was lacking."""
        before = self._published
        if before is None or self._used(info) == self._used(before):
            return True
        lacks_lens = all(self.missing(one) is not None for one in rectified)
        return lacks_lens and image_alone(info) == image_alone(before)

    def _note_other(self, info: CameraInfoFields, newest_ns: int) -> LensNews:
        waiting, dropped = "", 0
        if info not in self._others:
            if len(self._others) == MAX_OTHER_LENSES:
                del self._others[min(self._others, key=lambda i: self._others[i].n)]
                dropped = 1
            self._others[info] = _OtherLens(self._clock(), newest_ns)
            change = lens_change(self._camera.info_topic, self._published, info)
            waiting = f"{change} (waiting to see whether it lasts)"
        self._others[info].n += 1
        return LensNews(waiting, dropped)
