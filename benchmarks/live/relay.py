"""Cost of the clock relay: images over DDS through a `restamp` process.

Run ``python -m benchmarks.live.relay`` where the package is built and sourced.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import time
from collections.abc import Callable
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
from stcalib_ros.io.messages import NS
from stcalib_ros.io.stamps import stamp_of, with_stamp
from stcalib_ros.ros.publishers import latched

_OFFSET_S = 0.3
"""Time offset of the simulated calibration, s."""
_TIMEOUT_S = 30.0
"""Seconds until the relay must have subscribed."""


def main() -> None:
    """Print CPU time per message, delay and losses."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cameras", type=int, default=1, metavar="N")
    parser.add_argument("--hz", type=float, default=30.0)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--size", type=int, nargs=2, default=(1920, 1080), metavar=("W", "H"))
    parser.add_argument("--reliability", default="reliable", choices=("best_effort", "reliable"))
    args = parser.parse_args()
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
    names = [f"cam{i}" for i in range(args.cameras)]
    rclpy.init()
    relay = _relay(names, args.reliability)
    try:
        _measure(relay, names, args)
    finally:
        relay.terminate()
        relay.wait()
        rclpy.shutdown()


def _relay(names: list[str], reliability: str) -> subprocess.Popen[bytes]:
    prefixes = os.environ["AMENT_PREFIX_PATH"].split(os.pathsep)
    found = (Path(p) / "lib/stcalib_ros/restamp" for p in prefixes)
    parameters = {"cameras": f"[{','.join(names)}]", "result_topic": "/result"}
    parameters |= dict.fromkeys(("input_reliability", "output_reliability"), reliability)
    parameters |= {f"camera.{n}.topics": f"['/{n}/image:sensor_msgs/msg/Image']" for n in names}
    given = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    return subprocess.Popen([next(p for p in found if p.exists()), "--ros-args", *given])


def _measure(relay: subprocess.Popen[bytes], names: list[str], args: argparse.Namespace) -> None:
    node = rclpy.create_node("benchmark_relay")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    delays: list[float] = []
    sent_at: dict[tuple[str, int], float] = {}

    def received(name: str, data: bytes) -> None:
        key = (name, stamp_of(data) - round(_OFFSET_S * NS))
        delays.append(time.monotonic() - sent_at[key])

    qos = QoSProfile(depth=5, reliability=ReliabilityPolicy[args.reliability.upper()])
    publishers = {}
    for name in names:
        publishers[name] = node.create_publisher(Image, f"/{name}/image", qos)
        node.create_subscription(
            Image,
            f"/restamped/{name}/image",
            lambda data, name=name: received(name, data),
            qos,
            raw=True,
        )
    result = node.create_publisher(CalibrationResult, "/result", latched())
    result.publish(
        CalibrationResult(time_offsets=[TimeOffset(camera=n, offset_s=_OFFSET_S) for n in names])
    )
    _wait(executor, lambda: all(p.get_subscription_count() for p in publishers.values()))
    image = _image(*args.size)
    stamp_ns = 1_760_000_000 * NS
    while not delays:  # until the offsets are there
        stamp_ns += NS
        sent_at[names[0], stamp_ns] = time.monotonic()
        publishers[names[0]].publish(with_stamp(image, stamp_ns))
        executor.spin_once(timeout_sec=0.1)
    delays.clear()
    before_s, begin = usage(relay.pid).cpu_s, time.monotonic()
    n_sent = round(args.hz * args.seconds)
    for k in range(n_sent):
        while (rest := begin + k / args.hz - time.monotonic()) > 0:
            executor.spin_once(timeout_sec=rest)
        stamp_ns += NS
        for name, publisher in publishers.items():
            sent_at[name, stamp_ns] = time.monotonic()
            publisher.publish(with_stamp(image, stamp_ns))
    until = time.monotonic() + 1.0
    while time.monotonic() < until:
        executor.spin_once(timeout_sec=0.1)
    used_s = usage(relay.pid).cpu_s - before_s
    n_all = n_sent * len(names)
    width, height = args.size
    print(f"{len(names)} x {width} x {height} bgr8 at {args.hz:g} Hz for {args.seconds:g} s")
    print(f"sent {n_all}, received {len(delays)}")
    print(
        f"CPU of the relay: {used_s / len(delays) * 1e3:.2f} ms per message received, "
        f"{used_s / args.seconds * 100:.0f} % of a core"
    )
    p50, p99 = np.percentile(delays, [50, 99]) * 1e3
    print(
        f"from the publisher to the listener, through the relay: median {p50:.1f} ms, "
        f"p99 {p99:.1f} ms"
    )


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
    main()
