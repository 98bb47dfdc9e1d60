"""The threads that estimate: images of all cameras in turn, poses published as they are found."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message

from stcalib_ros.core.errors import InputError, one_line
from stcalib_ros.core.model.arrays import IntArray
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.estimation.newest import NewestImages
from stcalib_ros.estimation.poses import ImagePoses, PoseEstimator, UInt8Array
from stcalib_ros.estimation.tracking import PersonTracker, TrackingOptions
from stcalib_ros.io.images import compressed_pixels, image_pixels
from stcalib_ros.io.messages import NS
from stcalib_ros.io.stamps import stamp_of
from stcalib_ros.msg import PersonPose3D, PersonPose3DArray
from stcalib_ros.ros.convert import message_class
from stcalib_ros.ros.limits import MAX_LINE, SPIN_S
from stcalib_ros.ros.throttle import Throttle

_SMOOTHING = 0.1
"""Weight of the last image in the mean time of an image. Chosen: a mean over about ten."""


@dataclass(frozen=True, slots=True, eq=False)
class RawImage:
    """A message as it came: its type and its bytes in CDR."""

    kind: str
    data: bytes


class PoseWorker:
    """Takes images, estimates, follows persons and publishes.

    Parameters
    ----------
    estimators : sequence of PoseEstimator
        One for each thread, all of one kind.
    images : NewestImages
    publishers : mapping of str to rclpy.publisher.Publisher
        Of the poses of each camera.
    tracking : TrackingOptions
    throttle : Throttle

    Attributes
    ----------
    estimated, unreadable : dict of str to int
        Images of each camera.
    persons : dict of str to int
        In the last image of each.
    problems : dict of str to str
        Why the last image of a camera could not be used.
    image_s : float
        Seconds that an image takes, mean of the last ones.
    """

    def __init__(
        self,
        estimators: Sequence[PoseEstimator],
        images: NewestImages[RawImage],
        publishers: Mapping[str, Any],
        tracking: TrackingOptions,
        throttle: Throttle,
    ) -> None:
        self._images, self._publishers = images, publishers
        self._throttle = throttle
        self._trackers = {
            name: PersonTracker(estimators[0].layout, tracking) for name in publishers
        }
        self._stop = threading.Event()
        # Daemons, so that an estimator in the middle of an image does not keep the process alive.
        self._threads = [
            threading.Thread(target=self._run, args=(estimator,), daemon=True)
            for estimator in estimators
        ]
        self.estimated, self.unreadable = dict.fromkeys(publishers, 0), dict.fromkeys(publishers, 0)
        self.persons = dict.fromkeys(publishers, 0)
        self.problems: dict[str, str] = {}
        self.image_s = 0.0

    def start(self) -> None:
        """Begin to take images."""
        for thread in self._threads:
            thread.start()

    def stop(self, timeout_s: float) -> None:
        """End after the images that are being estimated, or after the timeout."""
        self._stop.set()
        end = time.monotonic() + timeout_s
        for thread in self._threads:
            thread.join(max(end - time.monotonic(), 0.0))

    def _run(self, estimator: PoseEstimator) -> None:
        while not self._stop.is_set():
            if (taken := self._images.take(SPIN_S)) is not None:
                self._use(estimator, *taken)
                self._images.done(taken[0])

    def _use(self, estimator: PoseEstimator, name: str, raw: RawImage) -> None:
        begin = time.perf_counter()
        try:
            message = deserialize_message(raw.data, message_class(raw.kind))
            poses = estimator.poses(pixels_of(message))
            poses, ids = self._trackers[name].follow(stamp_of(raw.data) / NS, poses)
            answer = poses_message(message.header, estimator.layout, poses, ids)
        except Exception as error:  # the node goes on, whatever a camera sends
            self.unreadable[name] += 1
            said = (
                str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
            )
            self.problems[name] = one_line(f"camera {name}: {said}", MAX_LINE)
            self._throttle(self.problems[name], self.problems[name], every_s=float("inf"))
            return
        if self._stop.is_set():
            return
        self._publishers[name].publish(answer)
        self.problems.pop(name, None)
        self.estimated[name] += 1
        self.persons[name] = len(ids)
        took_s = time.perf_counter() - begin
        weight = _SMOOTHING if self.image_s else 1.0
        self.image_s += weight * (took_s - self.image_s)


def pixels_of(message: Any) -> UInt8Array:
    """Return the pixels (height, width, 3) of an Image or CompressedImage: blue, green, red.

    Raises
    ------
    InputError
        They cannot be read.
    """
    if hasattr(message, "encoding"):
        return image_pixels(
            encoding=message.encoding,
            height=message.height,
            width=message.width,
            step=message.step,
            data=message.data,
        )
    return compressed_pixels(message.data)


def poses_message(
    header: Any, layout: Layout, poses: ImagePoses, ids: IntArray
) -> PersonPose3DArray:
    """Return the message of the persons in one image.

    Parameters
    ----------
    header : std_msgs.msg.Header
        Of the image, which it keeps.
    layout : Layout
    poses : ImagePoses
    ids : (P,) ndarray of int
    """
    in_3d = np.asarray(np.isfinite(poses.joints).any(axis=(1, 2)))
    persons = [
        PersonPose3D(
            track_id=int(ids[p]),
            score=float(np.nanmean(poses.scores[p])),
            joints=poses.joints[p].astype(np.float32).ravel() if in_3d[p] else [],
            keypoints=poses.keypoints[p].astype(np.float32).ravel(),
            joint_scores=poses.scores[p].astype(np.float32),
        )
        for p in range(len(ids))
    ]
    return PersonPose3DArray(
        header=header,
        layout=layout.name,
        joint_names=list(layout.joint_names),
        metric=bool(in_3d.any()),
        persons=persons,
    )
