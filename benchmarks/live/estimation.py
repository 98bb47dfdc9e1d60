"""The pose estimator and the calibrator beside each other: images over DDS in, calibration out.

    python -m benchmarks.live.estimation                       four cameras, 640 x 480, 10 Hz, noise
    python -m benchmarks.live.estimation --film examples/film  its cameras, each by its own clock
    python -m benchmarks.live.estimation --hz 30 --rate-hz 10 --estimator blazepose

Run it where the package is built and sourced, with the weights fetched. One process sends, this one
listens. MoveNet costs the same whoever is in an image. At the end of a film the calibrator is asked
for a calibration, which is compared with the truth of the film. Exit status 1 if a stamp is
changed, more images are lost than `MAX_LOST`, or the film is not calibrated.
"""

from __future__ import annotations

import argparse
import heapq
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import takewhile
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import CameraInfo, Image
from stcalib_ros.msg import PersonPose3DArray
from stcalib_ros.srv import Recalibrate
from std_msgs.msg import Header

from benchmarks.cost.process import usage
from benchmarks.table import Row, print_rows
from stcalib_ros.core.evaluation.metrics import evaluate
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.io.films import film_images, open_film
from stcalib_ros.io.messages import NS, fields_of_lens
from stcalib_ros.io.results import read_result
from stcalib_ros.ros.convert import camera_info_message, time_message

MAX_LOST = 0.02
"""Fraction of the needed images that may be dropped, or not arrive, at most."""
_FIRST_S = 1_760_000_000.0
"""Stamp of the first image, seconds since the epoch. Chosen."""
_APART_S = 0.013
"""Seconds between the clocks of two cameras. Chosen, so that no two stamps are the same."""
_TIMEOUT_S = 60.0
"""Seconds until the nodes must have subscribed, and the calibration must have ended."""
_REST_S = 2.0
"""Seconds that are waited for the last poses, and for nodes to know each other. Chosen."""
_FOCAL = 0.9
"""Ratio of focal length to width of the images. Chosen: usual cameras."""


class Shot(NamedTuple):
    """An image to send, when, and of which camera."""

    due_s: float
    camera: int
    stamp_s: float
    pixels: NDArray[np.uint8]


@dataclass(slots=True)
class Heard:
    """When poses of each camera came, by stamp; last diagnostics; what the calibrator said."""

    poses: dict[str, dict[int, float]] = field(default_factory=dict)
    n_persons: int = 0
    counts: dict[str, dict[str, str]] = field(default_factory=dict)
    calibrated: str = ""


def main() -> int:
    """Print what arrives, and what it costs.

    Returns
    -------
    int
        0 if the targets are met, else 1.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    add = parser.add_argument
    add("--film", type=Path, metavar="FOLDER", help="films and their truth; default: noise")
    add("--cameras", type=int, default=4, metavar="N")
    add("--size", type=int, nargs=2, default=(640, 480), metavar=("W", "H"), help="of noise")
    add("--hz", type=float, default=10.0, help="of the cameras; of a film at most")
    add("--rate-hz", type=float, default=10.0, help="parameter of the node")
    add("--seconds", type=float, default=30.0, help="of a film at most")
    add("--workers", type=int, default=2, help="parameter of the node")
    add("--estimator", default="movenet")
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
        results = sorted(Path(folder).glob("calibration.*.yaml"))
        found = read_result(results[-1]) if results else None
    rows = [*_rows(args, heard, sent, used_s), *_calibration_rows(args, heard, found)]
    print_rows(_title(args), rows, file=sys.stdout)
    return 0 if all(row.met is not False for row in rows) else 1


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
    known = time.monotonic() + _REST_S  # by then the nodes know that this one listens
    while time.monotonic() < known or not all(
        node.count_publishers(f"/{name}/person_poses") for name in names
    ):
        executor.spin_once(timeout_sec=0.1)
    before = [usage(pid).cpu_s for pid in pids]
    pipe.send(None)
    while not pipe.poll():
        executor.spin_once(timeout_sec=0.1)
    sent = pipe.recv()
    rest = time.monotonic() + _REST_S
    while time.monotonic() < rest:
        executor.spin_once(timeout_sec=0.1)
    used_s = [usage(pid).cpu_s - b for pid, b in zip(pids, before, strict=True)]
    client = node.create_client(Recalibrate, "/calibrator/recalibrate")
    answer = client.call_async(Recalibrate.Request(wait=True))
    executor.spin_until_future_complete(answer, timeout_sec=_TIMEOUT_S)
    heard.calibrated = answer.result().result.message if answer.done() else "no answer"
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
    lenses = _lenses(args)
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
    for shot in _shots(args):
        name = names[shot.camera]
        time.sleep(max(begin + shot.due_s - time.monotonic(), 0.0))
        stamp = time_message(_FIRST_S + shot.stamp_s)
        header = Header(stamp=stamp, frame_id=f"{name}_optical_frame")
        fields = fields_of_lens(lenses[shot.camera])
        infos[shot.camera].publish(camera_info_message(fields, header))
        sent[name][stamp.sec * NS + stamp.nanosec] = time.monotonic()
        images[shot.camera].publish(_image(header, shot.pixels))
    pipe.send(sent)
    rclpy.shutdown()


def _lenses(args: argparse.Namespace) -> list[Intrinsics]:
    if args.film:
        return [camera.intrinsics for camera in _truth(args).cameras]
    width, height = args.size
    focal, cx, cy = _FOCAL * width, (width - 1) / 2, (height - 1) / 2
    K = np.array([[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]])
    return [Intrinsics(width, height, LensModel.PLUMB_BOB, K, np.zeros(5))] * args.cameras


def _truth(args: argparse.Namespace) -> Calibration:
    """Return the truth of a film by the stamps that are sent."""
    truth = read_result(args.film / "truth.yaml")
    begin_s, end_s = (_FIRST_S + t for t in truth.window_s)
    return replace(
        truth,
        cameras=truth.cameras[: args.cameras],
        epoch_s=_FIRST_S + truth.epoch_s,
        window_s=(begin_s, end_s),
    )


def _shots(args: argparse.Namespace) -> Iterator[Shot]:
    """Yield the images of all cameras in the order of time, from 0 to the given seconds."""
    cameras = range(args.cameras)
    every = (_filmed(c, args) if args.film else _noise(c, args) for c in cameras)
    shots = heapq.merge(*every, key=lambda shot: (shot.due_s, shot.camera))
    return takewhile(lambda shot: shot.due_s < args.seconds, shots)


def _filmed(camera: int, args: argparse.Namespace) -> Iterator[Shot]:
    truth = _truth(args)
    first_s = min(one.time_offset_s for one in truth.cameras)
    one = truth.cameras[camera]
    film = open_film(one.name, args.film / f"{one.name}.mp4")
    for stamp_s, pixels in film_images(film, limit_hz=args.hz):
        yield Shot(stamp_s + one.time_offset_s - first_s, camera, stamp_s, pixels)


def _noise(camera: int, args: argparse.Namespace) -> Iterator[Shot]:
    width, height = args.size
    pixels = np.random.default_rng(camera).integers(0, 256, (height, width, 3), dtype=np.uint8)
    for k in range(round(args.hz * args.seconds)):
        due_s = (k + camera / args.cameras) / args.hz
        yield Shot(due_s, camera, due_s + camera * _APART_S, pixels)


def _image(header: Header, pixels: NDArray[np.uint8]) -> Any:
    height, width = pixels.shape[:2]
    image = Image(header=header, width=width, height=height, encoding="bgr8", step=3 * width)
    image.data = pixels.tobytes()
    return image


def _rows(
    args: argparse.Namespace,
    heard: Heard,
    sent: dict[str, dict[int, float]],
    used_s: Sequence[float],
) -> list[Row]:
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
    return [
        Row("sent", f"{n_sent} images, {total['received']} received", "", None),
        Row("not needed", f"{total['not_needed']}", "", None),
        Row("dropped", f"{total['dropped']} for newer ones", "", None),
        Row("poses", f"of {n_poses} images, {heard.n_persons} persons", "", None),
        Row("lost", f"{lost:.1%}", f"<= {MAX_LOST:.0%}", lost <= MAX_LOST),
        Row("stamps", f"{changed} changed", "none", changed == 0),
        Row("delay", f"median {p50:.0f} ms, 95 % {p95:.0f} ms", "", None),
        Row("image", f"{max((c['image_ms'] for c in counts), default='')} ms", "", None),
        Row("CPU", ", ".join(f"{s / args.seconds:.0%}" for s in used_s), "", None),
    ]


def _calibration_rows(
    args: argparse.Namespace, heard: Heard, found: Calibration | None
) -> Iterator[Row]:
    """What the calibrator has found in the film; noise has nobody in it."""
    if not args.film:
        return
    yield Row("calibrator", heard.calibrated.partition(";")[0], "", found is not None)
    if found is not None:
        errors = evaluate(found, _truth(args))
        offset_s = max(abs(camera.offset_s) for camera in errors.cameras)
        yield Row("E_R", f"{errors.E_R:.4f} rad", "", None)
        yield Row("E_t", f"{errors.E_t:.4f}", "", None)
        yield Row("offset", f"{1e3 * offset_s:.1f} ms, the largest", "", None)


def _title(args: argparse.Namespace) -> str:
    width, height = args.size
    what = f"{args.film}" if args.film else f"{width} x {height}"
    return (
        f"{args.cameras} x {what} at {args.hz:g} Hz for {args.seconds:g} s, {args.estimator}; "
        "CPU of the estimator and the calibrator, of a core"
    )


if __name__ == "__main__":
    sys.exit(main())
