"""The live node as a process of its own, and a client that publishes to it and calls it."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from stcalib_ros.io.bag_files import bag_files
from stcalib_ros.io.bag_records import RawMessage
from stcalib_ros.io.bag_source import raw_messages, topic_schemas
from stcalib_ros.ros.convert import message_class

TIMEOUT_S = 60.0
KNOWN_AFTER_S = 0.3
"""Each side discovers the other by itself. Until a server knows who reads its answer it throws it
away (rmw_fastrtps#842); so do best-effort readers with messages of one whom they do not know."""
AGAIN_AFTER_S = 5.0
RELIABLE = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(
    depth=10,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)


class LiveNode:
    """A process of the package, a calibrator unless another is named; what it says is in a file.

    A name with a ``/`` is one in a namespace.
    """

    def __init__(
        self,
        folder: Path,
        parameters: Mapping[str, str],
        name: str,
        *,
        setup_file: Path | None = None,
        executable: str = "calibrator",
        arguments: Sequence[str | Path] = (),
    ) -> None:
        prefixes = os.environ["AMENT_PREFIX_PATH"].split(os.pathsep)
        command = next(
            p for p in (Path(x) / "lib/stcalib_ros" / executable for x in prefixes) if p.exists()
        )
        given = [word for key, value in parameters.items() for word in ("-p", f"{key}:={value}")]
        script = f'source "{setup_file}"; exec "$@"'
        sourcing = [] if setup_file is None else ["bash", "-c", script, "bash"]
        self.given = parameters
        namespace, _, plain = name.rpartition("/")
        self.log = folder / f"{name.replace('/', '_')}.log"
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [
                    *(*sourcing, command, *arguments, "--ros-args"),
                    *("-r", f"__ns:=/{namespace}", "-r", f"__node:={plain}", *given),
                ],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )

    def stop(self, number: int = signal.SIGTERM) -> tuple[int, float]:
        """Exit status, and the seconds that it took."""
        begin = time.monotonic()
        self.process.send_signal(number)
        status = self.process.wait(timeout=TIMEOUT_S)
        return status, time.monotonic() - begin

    def kill(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()


class Client:
    """A ROS node in this process."""

    def __init__(self, target: str) -> None:
        self.target = target
        self.context = rclpy.Context()
        self.context.init()
        self.executor = SingleThreadedExecutor(context=self.context)
        self.node = rclpy.create_node(f"client_of_{target.replace('/', '_')}", context=self.context)
        self.executor.add_node(self.node)
        self.diagnostics: dict[str, dict[str, str]] = {}
        self.n_diagnostics = 0
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._diagnosed, 10)
        self._publishers: dict[str, Any] = {}
        self._clients: dict[str, Any] = {}

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.shutdown()

    def wait(self, done: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + TIMEOUT_S
        while not done():
            assert time.monotonic() < deadline, f"not within {TIMEOUT_S} s: {what}"
            self.executor.spin_once(timeout_sec=0.05)

    def result_of(self, future: Any, what: str) -> Any:
        self.wait(future.done, what)
        return future.result()

    def ask(self, kind: Any, name: str, **fields: Any) -> Any:
        """Future of the answer of a service."""
        if name not in self._clients:
            client = self._clients[name] = self.node.create_client(kind, f"/{self.target}/{name}")
            self.wait(client.service_is_ready, f"service {name}")
            self._become_known()
        return self._clients[name].call_async(kind.Request(**fields))

    def answer(self, kind: Any, name: str, **fields: Any) -> Any:
        return self.result_of(self.ask(kind, name, **fields), f"answer of {name}")

    def parameter(self, name: str) -> ParameterValue:
        """Asked for again until it is answered, which does no harm."""
        asked: list[Any] = []

        def answered() -> bool:
            if not asked or time.monotonic() > asked[-1][0] + AGAIN_AFTER_S:
                future = self.ask(GetParameters, "get_parameters", names=[name])
                asked.append((time.monotonic(), future))
            return any(future.done() for _, future in asked)

        self.wait(answered, f"parameter {name}")
        (value,) = next(future for _, future in asked if future.done()).result().values
        return value

    def latched(self, kind: Any, topic: str, count: int) -> list[Any]:
        """As many messages as one who comes late gets."""
        received: list[Any] = []
        listener = self.node.create_subscription(
            kind, f"/{self.target}/{topic}", received.append, LATCHED
        )
        self.wait(lambda: len(received) >= count, f"{count} messages on {topic}")
        self.node.destroy_subscription(listener)
        return received

    def status(self, part: str) -> dict[str, str]:
        return self.diagnostics.get(f"{self.target}: {part}", {})

    def next_diagnostics(self) -> None:
        seen = self.n_diagnostics
        self.wait(lambda: self.n_diagnostics > seen, "diagnostics")

    def publisher(self, kind: Any, topic: str) -> Any:
        if topic not in self._publishers:
            publisher = self._publishers[topic] = self.node.create_publisher(kind, topic, RELIABLE)
            self.wait(lambda: publisher.get_subscription_count() > 0, f"subscription to {topic}")
            self._become_known()
        return self._publishers[topic]

    def _become_known(self) -> None:
        known = time.monotonic() + KNOWN_AFTER_S
        self.wait(lambda: time.monotonic() > known, "discovery")

    def change(self, **values: object) -> list[tuple[bool, str]]:
        """Set parameters; for each whether it succeeded, and why not."""
        parameters = [Parameter(n, value=v).to_parameter_msg() for n, v in values.items()]
        said = self.answer(SetParameters, "set_parameters", parameters=parameters)
        return [(r.successful, r.reason) for r in said.results]

    def play(
        self,
        bag: Path,
        *,
        speed: float = 4.0,
        below: str = "",
        sent: Callable[[RawMessage], Any] = lambda raw: raw.data,
    ) -> None:
        """Publish the messages of a bag, stamps as they are, on its topics below a namespace.

        `sent` is what is sent in place of a message; None: nothing.
        """
        files = bag_files(bag)
        publishers = {
            s.topic: self.publisher(message_class(s.type_name), below + s.topic)
            for s in topic_schemas(files)
        }
        begin, first = time.monotonic(), None
        for raw in raw_messages(files, frozenset(publishers)):
            first = raw.log_time if first is None else first
            due = begin + (raw.log_time - first) * 1e-9 / speed
            while (rest := due - time.monotonic()) > 0:
                self.executor.spin_once(timeout_sec=rest)
            if (message := sent(raw)) is not None:
                publishers[raw.topic].publish(message)

    def play_completely(
        self,
        bag: Path,
        counts: Mapping[str, int],
        sent: Callable[[RawMessage], Any] = lambda raw: raw.data,
    ) -> None:
        """Play until every image has arrived: best effort may lose some, another time not."""
        deadline = time.monotonic() + TIMEOUT_S
        while True:
            self.play(bag, sent=sent)
            before: dict[str, int] = {}
            while (now := self.images(counts)) != before:
                before = now
                self.next_diagnostics()
            if now == counts:
                return
            assert time.monotonic() < deadline, f"arrived: {now} of {counts}"

    def images(self, names: Mapping[str, int]) -> dict[str, int]:
        self.next_diagnostics()
        return {n: int(self.status(f"camera {n}").get("images", -1)) for n in names}

    def _diagnosed(self, array: DiagnosticArray) -> None:
        if not any(s.name.startswith(f"{self.target}: ") for s in array.status):
            return
        self.n_diagnostics += 1
        for status in array.status:
            values = {v.key: v.value for v in status.values}
            self.diagnostics[status.name] = values | {"message": status.message}
