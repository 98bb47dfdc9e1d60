"""``ros2 run stcalib_ros pose_estimator``: camera images in, poses of persons out."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidTopicNameException
from rclpy.qos import QoSProfile, ReliabilityPolicy

from stcalib_ros.cli import run_command
from stcalib_ros.core.errors import InputError, one_line
from stcalib_ros.estimation.named import named_estimator
from stcalib_ros.estimation.newest import NewestImages
from stcalib_ros.estimation.tracking import TrackingOptions
from stcalib_ros.io.messages import NS
from stcalib_ros.io.stamps import stamp_of
from stcalib_ros.msg import PersonPose3DArray
from stcalib_ros.ros.convert import message_class
from stcalib_ros.ros.diagnostics import publishers_of
from stcalib_ros.ros.limits import (
    CHECK_S,
    LOOK_S,
    MAX_LINE,
    REPEAT_S,
    REPEAT_STARVED_S,
    STARVED_S,
    STOP_S,
)
from stcalib_ros.ros.parameter_specs import help_asked
from stcalib_ros.ros.pose_estimator_parameters import (
    IMAGE_TYPES,
    ImageCamera,
    declare_estimator,
    estimator_help,
)
from stcalib_ros.ros.pose_worker import PoseWorker, RawImage
from stcalib_ros.ros.running import events_executor, running_node, spin_until
from stcalib_ros.ros.throttle import Throttle

_DEPTH = 5
"""Images that wait in the subscription of a camera until they are looked at. Chosen: they are at
once, and a newer one takes the place of an older one then."""
_POSES_DEPTH = 10
"""Poses that wait for subscribers that ask for reliable ones. Chosen: a second."""


class PoseEstimatorNode:
    """The node: topics of images in, threads that estimate, topics of poses out.

    Parameters
    ----------
    node : rclpy.node.Node

    Raises
    ------
    InputError
        A parameter cannot be used, or the estimator not be loaded.
    """

    def __init__(self, node: Any) -> None:
        self.node, self.log = node, node.get_logger()
        settings = self.settings = declare_estimator(node)
        self._throttle = Throttle(self.log.warning)
        estimators = [
            named_estimator(
                settings.estimator,
                size=settings.size,
                threads=settings.threads,
                folder=settings.models_folder,
            )
            for _ in range(settings.workers)
        ]
        names = [camera.name for camera in settings.cameras]
        self._images = NewestImages[RawImage](names, rate_hz=settings.rate_hz)
        publishers = {c.name: self._publisher(c) for c in settings.cameras}
        self._subscriptions: dict[str, tuple[Any, str, bool]] = {}
        self._refused: dict[str, str] = {}
        tracking = TrackingOptions(settings.min_score, mend_sides=settings.mend_sides)
        self.worker = PoseWorker(estimators, self._images, publishers, tracking, self._throttle)
        self._logged = dict.fromkeys(names, 0)
        self._reported = -math.inf
        self._throttle.not_before("starved", STARVED_S)
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(LOOK_S, self._look, clock=steady)
        node.create_timer(CHECK_S, self._every_second, clock=steady)
        self.log.info(
            f"{settings.estimator} estimates {estimators[0].layout.name} of {', '.join(names)}, at "
            f"{f'{settings.rate_hz:g} images per second' if settings.rate_hz else 'all images'} "
            "of each at most"
        )

    def _publisher(self, camera: ImageCamera) -> Any:
        try:
            return self.node.create_publisher(PersonPose3DArray, camera.pose_topic, _POSES_DEPTH)
        except InvalidTopicNameException as error:
            said = one_line(f"{camera.pose_topic!r}: {error}", MAX_LINE)
            raise InputError(f"camera.{camera.name}.pose_topic: {said}") from None

    def _look(self) -> None:
        """Subscribe as the publishers of images offer; again, if that has changed."""
        for camera in self.settings.cameras:
            topic = self.node.resolve_topic_name(camera.image_topic)
            infos = self.node.get_publishers_info_by_topic(topic)
            if infos:
                self._follow_publishers(camera, topic, infos)

    def _follow_publishers(self, camera: ImageCamera, topic: str, infos: Sequence[Any]) -> None:
        kind = camera.image_type or _image_type(infos)
        if not kind:
            found = ", ".join(sorted({info.topic_type for info in infos}))
            self._refused[camera.name] = f"{topic} is a {found}, not {' or '.join(IMAGE_TYPES)}"
            self._throttle(f"type of {camera.name}", self._refused[camera.name])
            return
        self._refused.pop(camera.name, None)
        # Best effort receives from every publisher, but loses most large messages.
        offered = {info.qos_profile.reliability for info in infos}
        reliable = offered == {ReliabilityPolicy.RELIABLE}
        old = self._subscriptions.get(camera.name)
        if old is not None:
            if old[1:] == (kind, reliable):
                return
            self.node.destroy_subscription(old[0])
        policy = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        subscription = self.node.create_subscription(
            message_class(kind),
            topic,
            lambda data: self._take(camera.name, kind, data),
            QoSProfile(depth=_DEPTH, reliability=policy),
            raw=True,
        )
        self._subscriptions[camera.name] = (subscription, kind, reliable)

    def _take(self, name: str, kind: str, data: bytes) -> None:
        try:
            stamp_ns = stamp_of(data)
        except InputError as error:
            self._throttle(f"header of {name}", f"camera {name}: {error}")
            return
        self._images.put(name, stamp_ns / NS, RawImage(kind, data))

    def _every_second(self) -> None:
        array = DiagnosticArray(status=[self._status(camera) for camera in self.settings.cameras])
        array.header.stamp = self.node.get_clock().now().to_msg()
        self._diagnostics.publish(array)
        starved = [line for c in self.settings.cameras if (line := self._lack(c))]
        if starved:
            self._throttle("starved", "; ".join(starved), every_s=REPEAT_STARVED_S)
        if time.monotonic() - self._reported >= REPEAT_S:
            self._report_dropped()

    def _report_dropped(self) -> None:
        dropped = {name: self._images.counted(name).dropped for name in self._logged}
        new = {name: n - self._logged[name] for name, n in dropped.items()}
        if not any(new.values()):
            return
        self._reported, self._logged = time.monotonic(), dropped
        listed = ", ".join(f"{n} of {name}" for name, n in new.items() if n)
        self.log.warning(
            f"images dropped for newer ones: {listed}; an image takes "
            f"{self.worker.image_s * 1e3:.0f} ms: lower rate_hz or size, or raise workers"
        )

    def _lack(self, camera: ImageCamera) -> str:
        if self._images.counted(camera.name).received:
            return ""
        if camera.name in self._refused:
            return self._refused[camera.name]
        return f"no images of {camera.name}: {publishers_of(self.node, camera.image_topic)}"

    def _status(self, camera: ImageCamera) -> DiagnosticStatus:
        counts, worker = self._images.counted(camera.name), self.worker
        problem = self._lack(camera) or worker.problems.get(camera.name, "")
        level = DiagnosticStatus.WARN if problem or counts.dropped else DiagnosticStatus.OK
        values = {
            "received": counts.received,
            "not_needed": counts.not_needed,
            "dropped": counts.dropped,
            "estimated": worker.estimated[camera.name],
            "unreadable": worker.unreadable[camera.name],
            "persons": worker.persons[camera.name],
            "image_ms": f"{worker.image_s * 1e3:.1f}",
        }
        prefix = self.node.get_fully_qualified_name().strip("/")
        return DiagnosticStatus(
            level=level,
            name=f"{prefix}: camera {camera.name}",
            message=problem or (f"{counts.dropped} dropped" if counts.dropped else "estimating"),
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )


def _image_type(infos: Sequence[Any]) -> str:
    """Return the type that all publishers have, if it is one of images; else nothing."""
    types = {info.topic_type for info in infos}
    return str(types.pop()) if len(types) == 1 and types <= set(IMAGE_TYPES) else ""


def main() -> int:
    """Run the estimator until SIGINT or SIGTERM.

    Returns
    -------
    int
        Exit status: 0 stopped, or helped; 2 unusable parameters or estimator.
    """
    if help_asked(sys.argv[1:]):
        print(estimator_help())
        return 0
    return run_command("pose_estimator", _run)


def _run() -> None:
    with running_node("pose_estimator") as (node, stop):
        estimator = PoseEstimatorNode(node)
        estimator.worker.start()
        spin_until(stop, node, events_executor(node.context))
        estimator.worker.stop(STOP_S)
