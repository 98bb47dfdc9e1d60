"""The subscriptions of the live node."""

from __future__ import annotations

from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidTopicNameException
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from stcalib_ros.core.errors import InputError, one_line
from stcalib_ros.io.message_types import TYPES
from stcalib_ros.ros.convert import message_class
from stcalib_ros.ros.intake import Intake, Take
from stcalib_ros.ros.limits import MAX_LINE
from stcalib_ros.ros.parameters import Settings
from stcalib_ros.ros.people_topics import topics_of_people
from stcalib_ros.ros.publishers import latched


class Subscriptions:
    """Listens to every camera, as drivers send: best effort, volatile.

    Parameters
    ----------
    node : rclpy.node.Node
    settings : Settings
    intake : Intake
        Takes the messages.
    """

    def __init__(self, node: Any, settings: Settings, intake: Intake) -> None:
        self._node, self._cameras, self._intake = node, settings.cameras, intake
        self._latched: set[str] = set()
        self._people: dict[str, dict[str, Any]] = {camera.name: {} for camera in settings.cameras}
        self._max_people = settings.limits.max_persons
        self._qos = QoSProfile(
            depth=settings.queue_depth, reliability=ReliabilityPolicy.BEST_EFFORT
        )
        for camera in settings.cameras:
            if TYPES[camera.pose_type].topic_per_person:
                message_class(camera.pose_type)
            else:
                take = intake.poses_of(camera)
                self._listen(camera.pose_type, camera.pose_topic, take, self._qos)
            take_info = intake.info_of(camera)
            self._listen(camera.info_type, camera.info_topic, take_info, self._qos)
        self.follow_people()

    def follow_people(self) -> None:
        """Listen to people who have come, where everyone has a topic, and to no one who has gone.

        At most `max_persons` of a camera are followed at a time.
        """
        for camera in self._cameras:
            if not TYPES[camera.pose_type].topic_per_person:
                continue
            there, followed = topics_of_people(self._node, camera), self._people[camera.name]
            for topic in [topic for topic in followed if topic not in there]:
                self._node.destroy_subscription(followed.pop(topic))
                self._intake.forget_person(camera, topic)
            for topic, kind in there.items():
                if topic not in followed and len(followed) <= self._max_people:
                    take = self._intake.person_of(camera, topic, kind)
                    followed[topic] = self._listen(kind, topic, take, self._qos)

    def add_latched(self) -> None:
        """Listen once more where CameraInfo is latched.

        Some drivers send it once and latch it: only a transient local subscription gets what was
        sent before it was there, and only a volatile one what most drivers send; no QoS receives
        both. The second one is made when somebody offers what it asks for: to others it would be
        incompatible, and each of them would warn of it. A driver that latches and repeats is heard
        twice, which changes nothing: intrinsics that are known are no news.
        """
        for camera in self._cameras:
            topic = self._node.resolve_topic_name(camera.info_topic)
            if camera.name not in self._latched and any(
                offered.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
                and offered.qos_profile.reliability == ReliabilityPolicy.RELIABLE
                for offered in self._node.get_publishers_info_by_topic(topic)
            ):
                self._latched.add(camera.name)
                take = self._intake.info_of(camera)
                self._listen(camera.info_type, camera.info_topic, take, latched())

    def _listen(self, type_name: str, topic: str, take: Take, qos: QoSProfile) -> Any:
        """Subscribe without the events that rclpy would wait for besides, two per topic.

        They cost time: nothing is incompatible, and /diagnostics reports wrong types.
        """
        silent = SubscriptionEventCallbacks(use_default_callbacks=False)
        try:
            return self._node.create_subscription(
                message_class(type_name), topic, take, qos, raw=True, event_callbacks=silent
            )
        except InvalidTopicNameException as error:
            raise InputError(one_line(f"topic {topic!r}: {error}", MAX_LINE)) from error
