"""The pose estimator and the calibrator beside each other: images over DDS in, poses out.

    python -m benchmarks.live.estimation                      four cameras, 640 x 480, 10 Hz, noise
    python -m benchmarks.live.estimation --films a.mp4 b.mp4      images of films, repeated
    python -m benchmarks.live.estimation --hz 30 --rate-hz 10 --estimator blazepose

Run it where the package is built and sourced, with the weights fetched. One process sends, this one
listens. MoveNet costs the same whoever is in an image; the calibrator only calibrates where films
show people in common. Exit status 1 if a stamp is changed, or more images are lost than `MAX_LOST`.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import CameraInfo, Image
from stcalib_ros.msg import PersonPose3DArray
from std_msgs.msg import Header

from benchmarks.cost.process import usage
from benchmarks.table import Row, print_rows
from stcalib_ros.io.messages import NS
from stcalib_ros.ros.convert import time_message

MAX_LOST = 0.02
"""Fraction of the needed images that may be dropped, or not arrive, at most."""
_FIRST_S = 1_760_000_000.0
"""Stamp of the first image, seconds since the epoch. Chosen."""
_APART_S = 0.013
"""Seconds between the clocks of two cameras. Chosen, so that no two stamps are the same."""
_TIMEOUT_S = 60.0
"""Seconds until the nodes must have subscribed."""
_REST_S = 2.0
"""Seconds that are waited for the last poses."""
_MAX_FRAMES = 300
"""Images of a film that are used. Chosen: 270 MB of 640 x 480."""
_FOCAL = 0.9
"""Ratio of focal length to width of the images. Chosen: usual cameras."""

Frames = list[NDArray[np.uint8]]


@dataclass(slots=True)
class Heard:
    """What has come: when the poses of every camera arrived by stamp, and the last diagnostics."""

    poses: dict[str, dict[int, float]] = field(default_factory=dict)
    n_persons: int = 0
    counts: dict[str, dict[str, str]] = field(default_factory=dict)
    results: int = 0


def main() -> int:
    """Print what arrives, and what it costs.

    Returns
    -------
    int
        0 if the targets are met, else 1.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--films", type=Path, nargs="+", default=[])
    parser.add_argument("--cameras", type=int, default=4, metavar="N")
    parser.add_argument("--size", type=int, nargs=2, default=(640, 480), metavar=("W", "H"))
    parser.add_argument("--hz", type=float, default=10.0, help="of the cameras")
    parser.add_argument("--rate-hz", type=float, default=10.0, help="parameter of the node")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--workers", type=int, default=2, help="parameter of the node")
    parser.add_argument("--estimator", default="movenet")
    args = parser.parse_args()
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
    names = [f"cam{i}" for i in range(args.cameras)]
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    sender = context.Process(target=_send, args=(theirs, names, args))
    with tempfile.TemporaryDirectory() as folder, _nodes(names, args, folder) as processes:
        sender.start()
        heard, sent, used_s = _listen(ours, names, [p.pid for p in processes])
        sender.join()
    return _report(args, heard, sent, used_s)


@contextmanager
def _nodes(
    names: Sequence[str], args: argparse.Namespace, folder: str
) -> Iterator[list[subprocess.Popen[bytes]]]:
    listed = f"cameras:=[{','.join(names)}]"
    given = [f"{key}:={getattr(args, key)}" for key in ("estimator", "rate_hz", "workers")]
    processes = [
        _started("pose_estimator", listed, *given),
        _started("calibrator", listed, f"results_folder:={folder}"),
    ]
    try:
        yield processes
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
            process.wait()


def _started(executable: str, *parameters: str) -> subprocess.Popen[bytes]:
    prefixes = os.environ["AMENT_PREFIX_PATH"].split(os.pathsep)
    found = (Path(p) / "lib/stcalib_ros" / executable for p in prefixes)
    given = [word for parameter in parameters for word in ("-p", parameter)]
    return subprocess.Popen([next(p for p in found if p.exists()), "--ros-args", *given])


def _listen(
    pipe: Connection, names: Sequence[str], pids: Sequence[int]
) -> tuple[Heard, dict[str, dict[int, float]], list[float]]:
    """Listen until all is sent; also return when each stamp was sent, and CPU seconds by node."""
    rclpy.init()
    node = rclpy.create_node("benchmark_estimation")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    heard = Heard({name: {} for name in names})
    for name in names:
        node.create_subscription(
            PersonPose3DArray, f"/{name}/person_poses", lambda m, n=name: _take(heard, n, m), 100
        )
    node.create_subscription(DiagnosticArray, "/diagnostics", lambda m: _diagnosed(heard, m), 100)
    while not pipe.poll():  # the sender is ready when all images have subscribers
        executor.spin_once(timeout_sec=0.1)
    pipe.recv()
    before = [usage(pid).cpu_s for pid in pids]
    pipe.send(None)
    while not pipe.poll():
        executor.spin_once(timeout_sec=0.1)
    sent = pipe.recv()
    rest = time.monotonic() + _REST_S
    while time.monotonic() < rest:
        executor.spin_once(timeout_sec=0.1)
    used_s = [usage(pid).cpu_s - b for pid, b in zip(pids, before, strict=True)]
    rclpy.shutdown()
    return heard, sent, used_s


def _take(heard: Heard, name: str, message: PersonPose3DArray) -> None:
    stamp = message.header.stamp
    heard.poses[name][stamp.sec * NS + stamp.nanosec] = time.monotonic()
    heard.n_persons += len(message.persons)


def _diagnosed(heard: Heard, message: DiagnosticArray) -> None:
    for status in message.status:
        heard.counts[status.name] = {value.key: value.value for value in status.values}


def _send(pipe: Connection, names: Sequence[str], args: argparse.Namespace) -> None:
    """Send the images of all cameras at a steady rate; say what stamps were sent when."""
    rclpy.init()
    node = rclpy.create_node("benchmark_cameras")
    films = [_frames(k, args) for k in range(len(names))]
    images = [node.create_publisher(Image, f"/{name}/image_raw", 10) for name in names]
    infos = [node.create_publisher(CameraInfo, f"/{name}/camera_info", 10) for name in names]
    deadline = time.monotonic() + _TIMEOUT_S
    while not all(p.get_subscription_count() for p in images):
        if time.monotonic() > deadline:
            raise TimeoutError(f"the nodes do not listen within {_TIMEOUT_S:g} s")
        time.sleep(0.1)
    time.sleep(1.0)
    pipe.send(None)
    pipe.recv()
    sent: dict[str, dict[int, float]] = {name: {} for name in names}
    begin = time.monotonic()
    for k in range(round(args.hz * args.seconds)):
        for c, name in enumerate(names):
            due = begin + (k + c / len(names)) / args.hz
            time.sleep(max(due - time.monotonic(), 0.0))
            stamp = time_message(_FIRST_S + (k + c / len(names)) / args.hz + c * _APART_S)
            header = Header(stamp=stamp, frame_id=f"{name}_optical_frame")
            infos[c].publish(_info(header, args.size))
            sent[name][stamp.sec * NS + stamp.nanosec] = time.monotonic()
            images[c].publish(_image(header, films[c][k % len(films[c])]))
    pipe.send(sent)
    rclpy.shutdown()


def _frames(camera: int, args: argparse.Namespace) -> Frames:
    width, height = args.size
    if not args.films:
        rng = np.random.default_rng(camera)
        return [rng.integers(0, 256, (height, width, 3), dtype=np.uint8)]
    film = cv2.VideoCapture(str(args.films[camera % len(args.films)]))
    frames: Frames = []
    every = max(round(film.get(cv2.CAP_PROP_FPS) / args.hz), 1)
    while len(frames) < _MAX_FRAMES and film.grab():
        frames.append(cv2.resize(film.retrieve()[1], (width, height)))
        for _ in range(every - 1):
            film.grab()
    return frames


def _info(header: Header, size: Sequence[int]) -> CameraInfo:
    width, height = size
    focal = _FOCAL * width
    info = CameraInfo(header=header, width=width, height=height, distortion_model="plumb_bob")
    info.k = [focal, 0.0, (width - 1) / 2, 0.0, focal, (height - 1) / 2, 0.0, 0.0, 1.0]
    info.d = [0.0] * 5
    return info


def _image(header: Header, pixels: NDArray[np.uint8]) -> Any:
    height, width = pixels.shape[:2]
    image = Image(header=header, width=width, height=height, encoding="bgr8", step=3 * width)
    image.data = pixels.tobytes()
    return image


def _report(
    args: argparse.Namespace,
    heard: Heard,
    sent: dict[str, dict[int, float]],
    used_s: Sequence[float],
) -> int:
    n_sent = sum(len(stamps) for stamps in sent.values())
    delays_ms = [
        1e3 * (at - sent[name][stamp])
        for name, poses in heard.poses.items()
        for stamp, at in poses.items()
        if stamp in sent[name]
    ]
    n_poses = sum(len(poses) for poses in heard.poses.values())
    changed = n_poses - len(delays_ms)
    counts = [c for n, c in heard.counts.items() if n.startswith("pose_estimator: camera")]
    total = {
        key: sum(int(c[key]) for c in counts)
        for key in ("received", "not_needed", "dropped", "estimated")
    }
    needed = max(n_sent - total["not_needed"], 1)
    lost = 1 - n_poses / needed
    p50, p95 = np.percentile(delays_ms or [np.nan], [50, 95])
    solver = heard.counts.get("calibrator: solver", {})
    rows = [
        Row("sent", f"{n_sent} images, {total['received']} received", "", None),
        Row("not needed", f"{total['not_needed']}", "", None),
        Row("dropped", f"{total['dropped']} for newer ones", "", None),
        Row("poses", f"of {n_poses} images, {heard.n_persons} persons", "", None),
        Row("lost", f"{lost:.1%}", f"<= {MAX_LOST:.0%}", lost <= MAX_LOST),
        Row("stamps", f"{changed} changed", "none", changed == 0),
        Row("delay", f"median {p50:.0f} ms, 95 % {p95:.0f} ms", "", None),
        Row("image", f"{max((c['image_ms'] for c in counts), default='')} ms", "", None),
        Row("CPU", ", ".join(f"{s / args.seconds:.0%}" for s in used_s), "", None),
        Row("calibrator", solver.get("last_status", "") or "no calibration", "", None),
    ]
    width, height = args.size
    title = (
        f"{args.cameras} x {width} x {height} at {args.hz:g} Hz for {args.seconds:g} s, "
        f"{args.estimator}; CPU of the estimator and the calibrator, of a core"
    )
    print_rows(title, rows, file=sys.stdout)
    return 0 if lost <= MAX_LOST and changed == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
