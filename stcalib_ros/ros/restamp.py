"""``ros2 run stcalib_ros restamp``: republishes topics with the stamps of the reference clock."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidTopicNameException
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.results import read_result
from stcalib_ros.io.stamps import ClockCorrection, Restamper, changes, corrections_of, describe
from stcalib_ros.msg import CalibrationResult
from stcalib_ros.ros.convert import clock_corrections, message_class
from stcalib_ros.ros.diagnostics import STARVED_S, publishers_of
from stcalib_ros.ros.parameters import MAX_CAMERAS
from stcalib_ros.ros.publishers import latched
from stcalib_ros.ros.restamp_parameters import RelayedTopic, RelaySettings, declare_relay
from stcalib_ros.ros.running import spin_until, stop_on_signals

_HEADER = "std_msgs/Header"
_LOOK_S = 0.5
_MAX_TEXT = 256
_REPEAT_S = 5.0
_REPEAT_STARVED_S = 30.0


@dataclass(slots=True, eq=False)
class Stream:
    """One topic on its way.

    Attributes
    ----------
    given : RelayedTopic
    source, target : str
        Names as they are after remapping.
    restamper : Restamper
    publisher, subscription : rclpy's, or None
        None: its type, or its publishers' reliability, is not known yet.
    reliable : bool
        The subscription is.
    refused : str
        Why the topic cannot be relayed; empty if it can.
    held : bytes or None
        Last message of a latched topic.
    told : int
        Dropped messages that the log has.
    """

    given: RelayedTopic
    source: str
    target: str
    restamper: Restamper = field(default_factory=Restamper)
    publisher: Any = None
    subscription: Any = None
    reliable: bool = False
    refused: str = ""
    held: bytes | None = None
    told: int = 0


class Restamp:
    """The relay: topics in, the same topics out with other stamps.

    Messages are not decoded. Those that come before the offset of their camera is known are
    dropped, but the last one of a latched topic is kept, and sent with every new offset.

    Parameters
    ----------
    node : rclpy.node.Node

    Raises
    ------
    InputError
        A parameter or the result file cannot be used.
    """

    def __init__(self, node: Any) -> None:
        self.node, self.log = node, node.get_logger()
        self.settings = declare_relay(node)
        self._corrections: dict[str, ClockCorrection] = {}
        self.streams = [_stream(node, t, self.settings) for t in self.settings.topics]
        _require_apart(self.streams)
        self._started = self._warned = self._reported = time.monotonic()
        for stream in self.streams:
            if stream.given.type_name:
                self._open(stream, stream.given.type_name)
        if self.settings.result_file is not None:
            found = corrections_of(read_result(self.settings.result_file))
            self._take(found, str(self.settings.result_file))
        if self.settings.result_topic:
            node.create_subscription(
                CalibrationResult, self.settings.result_topic, self._result, latched()
            )
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(_LOOK_S, self._look, clock=steady)
        node.create_timer(1.0, self._every_second, clock=steady)

    def _result(self, message: CalibrationResult) -> None:
        name = f"result {message.run_id[:_MAX_TEXT]}"
        try:
            self._take(_usable_corrections(message), name)
        except InputError as error:
            self.log.error(f"{name} is not used: {error}")

    def _take(self, corrections: Mapping[str, ClockCorrection], source: str) -> None:
        """Use new offsets, all at once, from the next message on."""
        cameras = dict.fromkeys(stream.given.camera for stream in self.streams)
        known = {name: corrections[name] for name in cameras if name in corrections}
        if new := changes(self._corrections, known):
            told = ", ".join(f"{name} {change}" for name, change in new.items())
            self.log.info(f"{source}: clocks are corrected by: {told}")
        if missing := [name for name in cameras if name not in known]:
            self.log.warning(
                f"{source} has no offset of {', '.join(missing)}, only of "
                f"{', '.join(corrections) or 'none'}: its messages are dropped"
            )
        self._corrections = known
        for stream in self.streams:
            stream.restamper.correction = known.get(stream.given.camera)
            if stream.given.camera in new and stream.held is not None:
                self._send(stream, stream.restamper.again(stream.held))

    def _look(self) -> None:
        """Open the topics whose publishers have come, and follow their reliability."""
        for stream in self.streams:
            if stream.refused:
                continue
            infos = self.node.get_publishers_info_by_topic(stream.source)
            try:
                if stream.publisher is None and infos:
                    self._open(stream, _common_type(stream.source, infos), infos)
            except InputError as error:
                stream.refused = str(error)
                self.log.error(f"not relayed: {error}")
                continue
            if stream.publisher is not None:
                self._subscribe(stream, infos)

    def _wants_reliable(self, stream: Stream, infos: Sequence[Any]) -> bool:
        """Best effort takes from everybody, but most of what is large is lost with it."""
        if stream.given.latched or self.settings.input_reliability == "reliable":
            return True
        if self.settings.input_reliability == "best_effort":
            return False
        offered = {info.qos_profile.reliability for info in infos}
        return offered == {ReliabilityPolicy.RELIABLE}

    def _open(self, stream: Stream, type_name: str, infos: Sequence[Any] = ()) -> None:
        message_type = message_class_with_header(stream.source, type_name)
        reliable = self.settings.output_reliability == "reliable"
        qos = self._qos(stream, reliable=reliable)
        stream.publisher = self.node.create_publisher(message_type, stream.target, qos)
        self._subscribe(stream, infos)
        self.log.info(f"relays {stream.source} ({type_name}) to {stream.target}")

    def _subscribe(self, stream: Stream, infos: Sequence[Any]) -> None:
        """Subscribe as the publishers demand; again, if that has changed."""
        if not infos and self.settings.input_reliability == "auto":
            return
        reliable = self._wants_reliable(stream, infos)
        if stream.subscription is not None:
            if stream.reliable == reliable:
                return
            self.node.destroy_subscription(stream.subscription)
        stream.reliable = reliable
        stream.subscription = self.node.create_subscription(
            stream.publisher.msg_type,
            stream.source,
            lambda data: self._relay(stream, data),
            self._qos(stream, reliable=reliable),
            raw=True,
        )

    def _qos(self, stream: Stream, *, reliable: bool) -> QoSProfile:
        if stream.given.latched:
            return latched()
        return QoSProfile(
            depth=self.settings.queue_depth,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.VOLATILE,
        )

    def _relay(self, stream: Stream, data: bytes) -> None:
        if stream.given.latched:
            stream.held = data
        self._send(stream, stream.restamper(data))

    def _send(self, stream: Stream, data: bytes | None) -> None:
        if data is not None:
            stream.publisher.publish(data)

    def _every_second(self) -> None:
        array = DiagnosticArray(status=[self._status(stream) for stream in self.streams])
        array.header.stamp = self.node.get_clock().now().to_msg()
        self._diagnostics.publish(array)
        now = time.monotonic()
        if now - self._reported >= _REPEAT_S:
            self._reported = now
            self._tell_dropped()
        waited = now - self._started >= STARVED_S
        if waited and (self._warned == self._started or now - self._warned >= _REPEAT_STARVED_S):
            self._tell_starved(now)

    def _tell_dropped(self) -> None:
        for stream in self.streams:
            if (n := stream.restamper.dropped - stream.told) > 0:
                stream.told += n
                self.log.warning(f"{stream.source}: {n} dropped: {stream.restamper.problem}")

    def _tell_starved(self, now: float) -> None:
        lacks = [self._lack(stream) for stream in self.streams]
        if not self._corrections and self.settings.result_topic:
            lacks.append(f"no offsets yet: {publishers_of(self.node, self.settings.result_topic)}")
        if said := "; ".join(filter(None, lacks)):
            self._warned = now
            self.log.warning(said)

    def _lack(self, stream: Stream) -> str:
        if stream.refused or stream.restamper.relayed or stream.restamper.dropped:
            return ""
        return f"nothing has come: {publishers_of(self.node, stream.source)}"

    def _status(self, stream: Stream) -> DiagnosticStatus:
        restamper = stream.restamper
        level, message = DiagnosticStatus.OK, "relaying"
        if stream.refused:
            level, message = DiagnosticStatus.ERROR, stream.refused
        elif lack := self._lack(stream):
            level, message = DiagnosticStatus.WARN, lack
        elif restamper.correction is None or not restamper.relayed:
            level, message = DiagnosticStatus.WARN, restamper.problem
        correction = restamper.correction
        values = {
            "camera": stream.given.camera,
            "target": stream.target,
            "reliable": str(stream.reliable).lower(),
            "correction": describe(correction) if correction else "",
            "relayed": restamper.relayed,
            "dropped": restamper.dropped,
            "last_problem": restamper.problem,
        }
        prefix = self.node.get_fully_qualified_name().strip("/")
        return DiagnosticStatus(
            level=level,
            name=f"{prefix}: {stream.source}",
            message=message,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )


def _usable_corrections(message: CalibrationResult) -> dict[str, ClockCorrection]:
    if message.status != CalibrationResult.OK:
        raise InputError(message.message[:_MAX_TEXT] or "it says that it is not to be trusted")
    if (n := len(message.time_offsets)) > MAX_CAMERAS:
        raise InputError(f"it has {n} cameras; there can be {MAX_CAMERAS}")
    if any(len(offset.camera) > _MAX_TEXT for offset in message.time_offsets):
        raise InputError(f"the name of a camera is longer than {_MAX_TEXT} characters")
    return clock_corrections(message)


def message_class_with_header(topic: str, type_name: str) -> Any:
    """Class of a message that begins with a header.

    Parameters
    ----------
    topic : str
        For error messages.
    type_name : str
        ``sensor_msgs/msg/Image``.

    Raises
    ------
    InputError
        The package is not there, or the message begins with something else.
    """
    try:
        message_type = message_class(type_name)
    except InputError as error:
        raise InputError(f"{topic}: {error}") from None
    fields = message_type.get_fields_and_field_types()
    if next(iter(fields.values()), "") != _HEADER:
        first = next((f"{kind} {name}" for name, kind in fields.items()), "nothing")
        raise InputError(
            f"{topic}: {type_name} begins with {first!r}, not with a {_HEADER}: it has no stamp "
            "to correct"
        )
    return message_type


def _stream(node: Any, given: RelayedTopic, settings: RelaySettings) -> Stream:
    try:
        source = node.resolve_topic_name(given.topic)
        target = node.resolve_topic_name(f"{settings.output_prefix.rstrip('/')}{source}")
    except InvalidTopicNameException as error:
        raise InputError(f"topic {given.topic!r}: {error}".replace("\n", " ")) from None
    return Stream(given, source, target)


def _require_apart(streams: list[Stream]) -> None:
    """Demand that nothing is relayed twice or to itself, remapping included."""
    sources = [stream.source for stream in streams]
    targets = [stream.target for stream in streams]
    for names in (sources, targets, sources + targets):
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise InputError(f"{twice} would be relayed twice or to itself: look at the remapping")


def _common_type(topic: str, infos: Sequence[Any]) -> str:
    types = sorted({info.topic_type for info in infos})
    if len(types) > 1:
        raise InputError(f"{topic} has two types: {', '.join(types)}")
    return str(types[0])


def main() -> int:
    """Run the relay until SIGINT or SIGTERM.

    Returns
    -------
    int
        Exit status: 0 stopped, 2 unusable parameters or result file.
    """
    stop = stop_on_signals()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("restamp")
    try:
        Restamp(node)
    except InputError as error:
        print(f"restamp: {error}", file=sys.stderr)
        return 2
    spin_until(stop, node)
    node.destroy_node()
    rclpy.shutdown()
    return 0
