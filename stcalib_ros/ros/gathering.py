"""One image of the messages of single persons, which come one after another; knows no ROS."""

from __future__ import annotations

from types import SimpleNamespace

from stcalib_ros.io.messages import NS, stamp_ns
from stcalib_ros.ros.limits import GATHER_S, MAX_GATHERED, MAX_STAMP_STEP_S

_GATHER_NS, _STEP_NS = round(GATHER_S * NS), round(MAX_STAMP_STEP_S * NS)


class Gatherer:
    """Collects the persons of each image of a camera until it is complete.

    An image is complete once a message is `GATHER_S` newer. A person who comes later than that is
    left out, unless all stamps have gone back: then the clock was set, and it begins anew.
    """

    def __init__(self) -> None:
        self._images: dict[int, SimpleNamespace] = {}
        self._given_ns = 0
        self._frame_id = ""

    def add(self, message: SimpleNamespace) -> list[SimpleNamespace]:
        """Add a message; return the images that are complete now, by stamp.

        Parameters
        ----------
        message : SimpleNamespace
            With the fields of ``PersonPose3DArray``. Without persons it says that there are none:
            it is an image once a person has said what the frame is.

        Raises
        ------
        ValueError
            Its image was complete already.
        """
        stamp = stamp_ns(message)
        if max([stamp, self._given_ns, *self._images]) - stamp > _STEP_NS:
            self._images, self._given_ns = {}, 0
        if stamp <= self._given_ns:
            raise ValueError(f"a person of an image came more than {GATHER_S} s late")
        if not self._put(stamp, message):
            return []
        ready = sorted(self._images)
        done = [s for s in ready if ready[-1] - s >= _GATHER_NS]
        done = done or ready[: max(len(ready) - MAX_GATHERED, 0)]
        self._given_ns = max([self._given_ns, *done])
        return [self._images.pop(s) for s in done]

    def _put(self, stamp: int, message: SimpleNamespace) -> bool:
        if message.persons:
            self._frame_id = message.header.frame_id
        elif not self._frame_id:
            return False
        image = self._images.setdefault(stamp, message)
        if image is not message:
            image.persons = [*image.persons, *message.persons]
        image.header.frame_id = self._frame_id
        return True
