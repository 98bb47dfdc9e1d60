"""Cost of the clock relay: images over DDS, directly and through a `restamp` process.

    python -m benchmarks.live.relay                              one camera, 1920 x 1080 bgr8, 30 Hz
    python -m benchmarks.live.relay --cameras 4 --hz 60 --size 640 540    four of 1 MB at 60 Hz

Run it where the package is built and sourced. One process sends, one listens to what it sends, and
one to what the relay makes of it. Exit status 1 if less than nine tenths of what arrives directly
comes through the relay.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image
from stcalib_ros.msg import CalibrationResult, TimeOffset
from std_msgs.msg import Header

from benchmarks.cost.process import usage
from benchmarks.table import Row, print_rows
from stcalib_ros.io.messages import NS
from stcalib_ros.io.stamps import stamp_of, with_stamp
from stcalib_ros.ros.publishers import latched

_OFFSET_S = 0.3
"""Time offset of the simulated calibration, s."""
_TIMEOUT_S = 30.0
"""Seconds until the relay and the listeners must have subscribed."""
_REST_S = 1.0
"""Seconds that are waited for the last messages."""
MIN_SHARE = 0.9
"""Messages through the relay over messages received directly, at least."""


def main() -> int:
    """Print CPU time per message, delays and losses.

    Returns
    -------
    int
        0 if the target is met, else 1.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--cameras", type=int, default=1, metavar="N")
    parser.add_argument("--hz", type=float, default=30.0)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--size", type=int, nargs=2, default=(1920, 1080), metavar=("W", "H"))
    parser.add_argument("--reliability", default="reliable", choices=("best_effort", "reliable"))
    args = parser.parse_args()
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
    names = [f"cam{i}" for i in range(args.cameras)]
    listeners = [_Listener.started(p, names, args.reliability) for p in ("", "/restamped")]
    relay = _relay(names, args.reliability)
    rclpy.init()
    try:
        used_s = _send(relay.pid, names, args)
    finally:
        relay.terminate()
        relay.wait()
        rclpy.shutdown()
    direct, relayed = (listener.delays_ms() for listener in listeners)
    return _report(args, direct, relayed, used_s)


def _report(
    args: argparse.Namespace, direct: list[float], relayed: list[float], used_s: float
) -> int:
    n_sent = round(args.hz * args.seconds) * args.cameras
    share = len(relayed) / max(len(direct), 1)
    rows = [
        Row("direct", _arrived(direct, n_sent), "", None),
        Row("through relay", _arrived(relayed, n_sent), "", None),
        Row("share", f"{share:.1%}", f">= {MIN_SHARE:.0%}", share >= MIN_SHARE),
        Row(
            "CPU of relay",
            f"{used_s / max(len(relayed), 1) * 1e3:.2f} ms per message, "
            f"{used_s / args.seconds:.0%} of a core",
            "",
            None,
        ),
    ]
    width, height = args.size
    title = f"{args.cameras} x {width} x {height} bgr8 at {args.hz:g} Hz for {args.seconds:g} s"
    print_rows(title, rows, file=sys.stdout)
    return 0 if share >= MIN_SHARE else 1


def _arrived(delays_ms: list[float], n_sent: int) -> str:
    if not delays_ms:
        return f"none of {n_sent}"
    p50, p99 = np.percentile(delays_ms, [50, 99])
    return f"{len(delays_ms) / n_sent:.1%}, median {p50:.1f} ms, p99 {p99:.1f} ms"


@dataclass(frozen=True, slots=True)
class _Listener:
    """A process that listens to the images of all cameras until it is asked for their delays."""

    process: multiprocessing.process.BaseProcess
    pipe: Connection

    @staticmethod
    def started(prefix: str, names: list[str], reliability: str) -> _Listener:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_listen, args=(theirs, prefix, names, reliability))
        process.start()
        return _Listener(process, ours)

    def delays_ms(self) -> list[float]:
        self.pipe.send(None)
        delays: list[float] = self.pipe.recv()
        self.process.join()
        return delays


def _listen(pipe: Connection, prefix: str, names: list[str], reliability: str) -> None:
    """Receive images; the last eight bytes say when they were sent, -1 before the measurement."""
    rclpy.init()
    node = rclpy.create_node(f"listener{prefix.replace('/', '_')}")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    delays: list[float] = []

    def received(data: bytes) -> None:
        sent_ns = int.from_bytes(data[-8:], "little", signed=True)
        if sent_ns >= 0:
            delays.append((time.monotonic_ns() - sent_ns) * 1e-6)

    for name in names:
        topic = f"{prefix}/{name}/image"
        node.create_subscription(Image, topic, received, _qos(reliability), raw=True)
    while not pipe.poll():
        executor.spin_once(timeout_sec=0.1)
    pipe.send(delays)
    rclpy.shutdown()


def _qos(reliability: str) -> QoSProfile:
    return QoSProfile(depth=10, reliability=ReliabilityPolicy[reliability.upper()])


def _relay(names: list[str], reliability: str) -> subprocess.Popen[bytes]:
    prefixes = os.environ["AMENT_PREFIX_PATH"].split(os.pathsep)
    found = (Path(p) / "lib/stcalib_ros/restamp" for p in prefixes)
    parameters = {"cameras": f"[{','.join(names)}]", "result_topic": "/result"}
    parameters |= dict.fromkeys(("input_reliability", "output_reliability"), reliability)
    parameters |= {f"camera.{n}.topics": f"['/{n}/image:sensor_msgs/msg/Image']" for n in names}
    given = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    return subprocess.Popen([next(p for p in found if p.exists()), "--ros-args", *given])


def _send(relay_pid: int, names: list[str], args: argparse.Namespace) -> float:
    """Send the images of all cameras; return the CPU time of the relay meanwhile, s."""
    node = rclpy.create_node("benchmark_relay")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    publishers = [
        node.create_publisher(Image, f"/{name}/image", _qos(args.reliability)) for name in names
    ]
    relayed: set[int] = set()
    first = node.create_subscription(
        Image,
        f"/restamped/{names[0]}/image",
        lambda data: relayed.add(stamp_of(data)),
        _qos(args.reliability),
        raw=True,
    )
    result = node.create_publisher(CalibrationResult, "/result", latched())
    result.publish(
        CalibrationResult(time_offsets=[TimeOffset(camera=n, offset_s=_OFFSET_S) for n in names])
    )
    _wait(executor, lambda: all(p.get_subscription_count() == 2 for p in publishers))
    image, stamp_ns = _image(*args.size), 1_760_000_000 * NS
    while not relayed:  # until the offsets are there
        stamp_ns += NS
        publishers[0].publish(_sent(image, stamp_ns, -1))
        executor.spin_once(timeout_sec=0.1)
    node.destroy_subscription(first)
    before_s, begin = usage(relay_pid).cpu_s, time.monotonic()
    for k in range(round(args.hz * args.seconds)):
        time.sleep(max(begin + k / args.hz - time.monotonic(), 0.0))
        stamp_ns += NS
        for publisher in publishers:
            publisher.publish(_sent(image, stamp_ns, time.monotonic_ns()))
    time.sleep(_REST_S)
    return usage(relay_pid).cpu_s - before_s


def _sent(image: bytes, stamp_ns: int, sent_ns: int) -> bytes:
    return with_stamp(image[:-8] + sent_ns.to_bytes(8, "little", signed=True), stamp_ns)


def _image(width: int, height: int) -> bytes:
    pixels = np.random.default_rng(0).integers(0, 256, 3 * width * height, dtype=np.uint8)
    message = Image(
        header=Header(frame_id="optical_frame"),
        width=width,
        height=height,
        encoding="bgr8",
        step=3 * width,
    )
    message.data = pixels.tobytes()
    return bytes(serialize_message(message))


def _wait(executor: SingleThreadedExecutor, done: Callable[[], bool]) -> None:
    deadline = time.monotonic() + _TIMEOUT_S
    while not done():
        if time.monotonic() > deadline:
            raise TimeoutError(f"the relay does not listen within {_TIMEOUT_S:g} s")
        executor.spin_once(timeout_sec=0.1)


if __name__ == "__main__":
    sys.exit(main())
