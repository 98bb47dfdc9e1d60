"""Throughput of the live node with many cameras while it calibrates.

    python -m benchmarks.live.intake                     12 cameras at 30 Hz, 6 people, 10 minutes
    python -m benchmarks.live.intake --minutes 2 --cameras 4

Plays a simulated scene in a loop to the real node over DDS, from other processes, and lets it
calibrate repeatedly. Needs ROS 2: `make env`, then `source scripts/activate.sh`.

Exit status 1 if a target is missed.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from multiprocessing.connection import Connection
from pathlib import Path

from benchmarks.live.figures import Observed, rows
from benchmarks.live.player import WINDOW_S, Sent, play
from benchmarks.live.watcher import Watcher
from benchmarks.table import finite, print_rows
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.mocap import shipped_clips

_FPS = 30.0
"""Frame rate of the simulated cameras, Hz."""
_SETTLE_S = 2.0
"""Seconds of observation before the first and after the last message."""
_START_S = 60.0
"""Seconds until all topics must have a subscriber."""
_PAUSE_S = 5.0
"""Seconds between the end of a calibration and the next request."""
_STOP_S = 20.0
"""Seconds after SIGINT until the process counts as hung."""
_LOG = "calibrator.log"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark and print the table.

    Returns
    -------
    int
        0 if all targets are met, 1 if not, 2 where ROS or the node is not there.
    """
    args = _arguments(argv)
    if (executable := _executable()) is None:
        print(
            "benchmarks.live.intake: no calibrator in AMENT_PREFIX_PATH: "
            "make env, then source scripts/activate.sh",
            file=sys.stderr,
        )
        return 2
    # Nothing leaves this machine, and no other node is met.
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
    with tempfile.TemporaryDirectory() as folder:
        observed = measure(executable, args, Path(folder))
    table = rows(observed)
    title = (
        f"live: {args.cameras} cameras at {_FPS:g} Hz, {args.people} people, "
        f"{args.minutes:g} minutes, load average {os.getloadavg()[2]:.1f}"
    )
    print_rows(title, table, file=sys.stderr if args.json else sys.stdout)
    if args.json:
        figures = {"rows": [asdict(row) for row in table], "observed": asdict(observed)}
        print(json.dumps(finite(figures), indent=2))
    return 0 if all(row.met is not False for row in table) else 1


def measure(executable: Path, args: argparse.Namespace, folder: Path) -> Observed:
    """Run node, players and watcher, and return the observations."""
    bag, cameras = _bag(args, folder), [f"cam{c}" for c in range(args.cameras)]
    groups = [cameras[k :: args.players] for k in range(args.players)]
    with _players(bag, groups) as controls, _node(executable, cameras, folder) as node:
        if not all(control.poll(_START_S) and control.recv() for control in controls):
            raise TimeoutError(f"the node does not listen: {_last_line(folder)}")
        watcher = Watcher("calibrator", node.pid, first_after_s=_first_s(args), pause_s=_PAUSE_S)
        watcher.watch(_SETTLE_S)
        for control in controls:
            control.send(time.time() + 0.5)
        watcher.watch(60.0 * args.minutes, solving=True)
        sent: dict[str, Sent] = {}
        for control in controls:
            control.send("stop")
            sent |= control.recv()
        watcher.watch(_SETTLE_S)
        begin = time.monotonic()
        node.send_signal(signal.SIGINT)
        status = node.wait(_STOP_S)
        observed = watcher.observed(sent, status, time.monotonic() - begin)
        watcher.close()
    return observed


def _first_s(args: argparse.Namespace) -> float:
    """Time of the first request for a calibration: a full window, in runs that are long enough."""
    return float(min(WINDOW_S, 60.0 * args.minutes / 3))


def _bag(args: argparse.Namespace, folder: Path) -> Path:
    path = folder / "scene.mcap"
    options = SceneOptions(
        n_cameras=args.cameras,
        n_people=args.people,
        n_frames=round(args.scene_s * _FPS),
        fps=_FPS,
        area_radius_m=2.0,
        seed=args.seed,
    )
    write_bag(simulate(options, clips=shipped_clips()).recording, path)
    return path


@contextmanager
def _players(bag: Path, groups: Sequence[Sequence[str]]) -> Iterator[list[Connection]]:
    """Start processes that each play some of the cameras, and yield their control connections."""
    context = multiprocessing.get_context("spawn")
    controls, processes = [], []
    for cameras in groups:
        ours, theirs = context.Pipe()
        process = context.Process(target=play, args=(bag, cameras, theirs), daemon=True)
        process.start()
        controls.append(ours)
        processes.append(process)
    try:
        yield controls
    finally:
        for process in processes:
            process.kill()
            process.join()


@contextmanager
def _node(
    executable: Path, cameras: Sequence[str], folder: Path
) -> Iterator[subprocess.Popen[bytes]]:
    parameters: Mapping[str, str] = {
        "cameras": f"[{', '.join(cameras)}]",
        "auto_calibrate": "false",
        "results_folder": str(folder / "results"),
        "window_s": str(WINDOW_S),
    }
    given = [word for key, value in parameters.items() for word in ("-p", f"{key}:={value}")]
    with (folder / _LOG).open("wb") as log:
        process = subprocess.Popen(
            [executable, "--ros-args", *given], stdin=subprocess.DEVNULL, stdout=log, stderr=log
        )
        try:
            yield process
        finally:
            process.kill()
            process.wait()


def _last_line(folder: Path) -> str:
    lines = (folder / _LOG).read_text().splitlines()
    return lines[-1] if lines else "it has logged nothing"


def _executable() -> Path | None:
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    paths = (Path(prefix) / "lib/stcalib_ros/calibrator" for prefix in prefixes)
    return next((path for path in paths if path.exists()), None)


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.live.intake", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--minutes", type=float, default=10.0, metavar="N", help="default 10")
    parser.add_argument("--cameras", type=int, default=12, metavar="N", help="default 12")
    parser.add_argument("--people", type=int, default=6, metavar="N", help="default 6")
    parser.add_argument("--players", type=int, default=2, metavar="N", help="processes (default 2)")
    parser.add_argument("--scene-s", type=float, default=60.0, metavar="S", help="default 60")
    parser.add_argument(
        "--seed", type=int, default=7, metavar="N", help="seed of the scene (default 7)"
    )
    parser.add_argument("--json", action="store_true", help="every sample as JSON on stdout")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
