"""``ros2 run stcalib_ros restamp``: republishes topics with the stamps of the reference clock."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidTopicNameException
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from stcalib_ros.cli import run_command
from stcalib_ros.core.errors import InputError
from stcalib_ros.io.results import read_result
from stcalib_ros.io.stamps import ClockCorrection, Restamper, changes, corrections_of, describe
from stcalib_ros.msg import CalibrationResult
from stcalib_ros.ros.convert import clock_corrections, message_class
from stcalib_ros.ros.diagnostics import publishers_of
from stcalib_ros.ros.limits import (
    CHECK_S,
    LOOK_S,
    MAX_CAMERAS,
    MAX_TEXT,
    REPEAT_S,
    REPEAT_STARVED_S,
    STARVED_S,
)
from stcalib_ros.ros.parameter_specs import help_asked
from stcalib_ros.ros.publishers import latched
from stcalib_ros.ros.restamp_parameters import (
    RelayedTopic,
    RelaySettings,
    declare_relay,
    relay_help,
)
from stcalib_ros.ros.running import events_executor, running_node, spin_until

_HEADER = "std_msgs/Header"


@dataclass(slots=True, eq=False)
class Relay:
    """One topic that is relayed.

    Attributes
    ----------
    given : RelayedTopic
    source, target : str
        Names after remapping.
    restamper : Restamper
    publisher, subscription : rclpy's, or None
        None: its type, or its publishers' reliability, is not known yet.
    reliable : bool
        The subscription is reliable.
    refused : str
        Why the topic cannot be relayed; empty if it can.
    held : bytes or None
        Last message of a latched topic.
    n_logged : int
        Dropped messages that were reported in the log.
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
    n_logged: int = 0


class Restamp:
    """The relay node: topics in, the same topics out with corrected stamps.

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
        self.relays = [_relay_of(node, t, self.settings) for t in self.settings.topics]
        _require_distinct(self.relays)
        self._started = self._warned = self._reported = time.monotonic()
        for relay in self.relays:
            if relay.given.type_name:
                self._open(relay, relay.given.type_name)
        if self.settings.result_file is not None:
            found = corrections_of(read_result(self.settings.result_file))
            self._take(found, str(self.settings.result_file))
        if self.settings.result_topic:
            node.create_subscription(
                CalibrationResult, self.settings.result_topic, self._result, latched()
            )
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(LOOK_S, self._look, clock=steady)
        node.create_timer(CHECK_S, self._every_second, clock=steady)

    def _result(self, message: CalibrationResult) -> None:
        name = f"result {message.run_id[:MAX_TEXT]}"
        try:
            self._take(_usable_corrections(message), name)
        except InputError as error:
            self.log.error(f"{name} is not used: {error}")

    def _take(self, corrections: Mapping[str, ClockCorrection], source: str) -> None:
        """Use new offsets, all at once, from the next message on."""
        cameras = dict.fromkeys(relay.given.camera for relay in self.relays)
        known = {name: corrections[name] for name in cameras if name in corrections}
        if new := changes(self._corrections, known):
            listed = ", ".join(f"{name} {change}" for name, change in new.items())
            self.log.info(f"{source}: clocks are corrected by: {listed}")
        if missing := [name for name in cameras if name not in known]:
            self.log.warning(
                f"{source} has no offset of {', '.join(missing)}, only of "
                f"{', '.join(corrections) or 'none'}: its messages are dropped"
            )
        self._corrections = known
        for relay in self.relays:
            relay.restamper.correction = known.get(relay.given.camera)
            if relay.given.camera in new and relay.held is not None:
                self._send(relay, relay.restamper.again(relay.held))

    def _look(self) -> None:
        """Open the topics that have publishers by now, and follow their reliability."""
        for relay in self.relays:
            if relay.refused:
                continue
            infos = self.node.get_publishers_info_by_topic(relay.source)
            try:
                if relay.publisher is None and infos:
                    self._open(relay, _common_type(relay.source, infos), infos)
            except InputError as error:
                relay.refused = str(error)
                self.log.error(f"not relayed: {error}")
                continue
            if relay.publisher is not None:
                self._subscribe(relay, infos)

    def _wants_reliable(self, relay: Relay, infos: Sequence[Any]) -> bool:
        """Best effort receives from every publisher, but loses most large messages."""
        if relay.given.latched or self.settings.input_reliability == "reliable":
            return True
        if self.settings.input_reliability == "best_effort":
            return False
        offered = {info.qos_profile.reliability for info in infos}
        return offered == {ReliabilityPolicy.RELIABLE}

    def _open(self, relay: Relay, type_name: str, infos: Sequence[Any] = ()) -> None:
        message_type = message_class_with_header(relay.source, type_name)
        reliable = self.settings.output_reliability == "reliable"
        qos = self._qos(relay, reliable=reliable)
        relay.publisher = self.node.create_publisher(message_type, relay.target, qos)
        self._subscribe(relay, infos)
        self.log.info(f"relays {relay.source} ({type_name}) to {relay.target}")

    def _subscribe(self, relay: Relay, infos: Sequence[Any]) -> None:
        """Subscribe as the publishers offer; again, if that has changed."""
        if not infos and self.settings.input_reliability == "auto":
            return
        reliable = self._wants_reliable(relay, infos)
        if relay.subscription is not None:
            if relay.reliable == reliable:
                return
            self.node.destroy_subscription(relay.subscription)
        relay.reliable = reliable
        relay.subscription = self.node.create_subscription(
            relay.publisher.msg_type,
            relay.source,
            lambda data: self._forward(relay, data),
            self._qos(relay, reliable=reliable),
            raw=True,
        )

    def _qos(self, relay: Relay, *, reliable: bool) -> QoSProfile:
        if relay.given.latched:
            return latched()
        return QoSProfile(
            depth=self.settings.queue_depth,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.VOLATILE,
        )

    def _forward(self, relay: Relay, data: bytes) -> None:
        if relay.given.latched:
            relay.held = data
        self._send(relay, relay.restamper(data))

    def _send(self, relay: Relay, data: bytes | None) -> None:
        if data is not None:
            relay.publisher.publish(data)

    def _every_second(self) -> None:
        array = DiagnosticArray(status=[self._status(relay) for relay in self.relays])
        array.header.stamp = self.node.get_clock().now().to_msg()
        self._diagnostics.publish(array)
        now = time.monotonic()
        if now - self._reported >= REPEAT_S:
            self._reported = now
            self._report_dropped()
        waited = now - self._started >= STARVED_S
        if waited and (self._warned == self._started or now - self._warned >= REPEAT_STARVED_S):
            self._report_starved(now)

    def _report_dropped(self) -> None:
        for relay in self.relays:
            if (n := relay.restamper.dropped - relay.n_logged) > 0:
                relay.n_logged += n
                self.log.warning(f"{relay.source}: {n} dropped: {relay.restamper.problem}")

    def _report_starved(self, now: float) -> None:
        lacks = [self._lack(relay) for relay in self.relays]
        if not self._corrections and self.settings.result_topic:
            lacks.append(f"no offsets yet: {publishers_of(self.node, self.settings.result_topic)}")
        if line := "; ".join(filter(None, lacks)):
            self._warned = now
            self.log.warning(line)

    def _lack(self, relay: Relay) -> str:
        if relay.refused or relay.restamper.relayed or relay.restamper.dropped:
            return ""
        return f"nothing received: {publishers_of(self.node, relay.source)}"

    def _status(self, relay: Relay) -> DiagnosticStatus:
        restamper = relay.restamper
        level, message = DiagnosticStatus.OK, "relaying"
        if relay.refused:
            level, message = DiagnosticStatus.ERROR, relay.refused
        elif lack := self._lack(relay):
            level, message = DiagnosticStatus.WARN, lack
        elif restamper.correction is None or not restamper.relayed:
            level, message = DiagnosticStatus.WARN, restamper.problem
        correction = restamper.correction
        values = {
            "camera": relay.given.camera,
            "target": relay.target,
            "reliable": str(relay.reliable).lower(),
            "correction": describe(correction) if correction else "",
            "relayed": restamper.relayed,
            "dropped": restamper.dropped,
            "last_problem": restamper.problem,
        }
        prefix = self.node.get_fully_qualified_name().strip("/")
        return DiagnosticStatus(
            level=level,
            name=f"{prefix}: {relay.source}",
            message=message,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )


def _usable_corrections(message: CalibrationResult) -> dict[str, ClockCorrection]:
    if message.status != CalibrationResult.OK:
        raise InputError(message.message[:MAX_TEXT] or "its status is not OK")
    if (n := len(message.time_offsets)) > MAX_CAMERAS:
        raise InputError(f"it has {n} cameras; there can be {MAX_CAMERAS}")
    if any(len(offset.camera) > MAX_TEXT for offset in message.time_offsets):
        raise InputError(f"the name of a camera is longer than {MAX_TEXT} characters")
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


def _relay_of(node: Any, given: RelayedTopic, settings: RelaySettings) -> Relay:
    try:
        source = node.resolve_topic_name(given.topic)
        target = node.resolve_topic_name(f"{settings.output_prefix.rstrip('/')}{source}")
    except InvalidTopicNameException as error:
        raise InputError(f"topic {given.topic!r}: {error}".replace("\n", " ")) from None
    return Relay(given, source, target)


def _require_distinct(relays: list[Relay]) -> None:
    """Demand that nothing is relayed twice or to itself, remapping included."""
    sources = [relay.source for relay in relays]
    targets = [relay.target for relay in relays]
    for names in (sources, targets, sources + targets):
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise InputError(f"{twice} would be relayed twice or to itself: check the remapping")


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
        Exit status: 0 stopped, or helped; 2 unusable parameters or result file.
    """
    if help_asked(sys.argv[1:]):
        print(relay_help())
        return 0
    return run_command("restamp", _run)


def _run() -> None:
    with running_node("restamp") as (node, stop):
        Restamp(node)
        spin_until(stop, node, events_executor(node.context))
