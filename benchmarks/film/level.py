"""What a calibration makes of the film: films in, calibration out, beside the truth.

    python -m benchmarks.film.level
    python -m benchmarks.film.level --input-size 256 512
    python -m benchmarks.film.level --cameras 6 --intrinsics unknown
    python -m benchmarks.film.level --line-delay given estimated

Each section is one command, `stcalib calibrate cam0.mp4 ... --output walk.yaml`. One camera has a
rolling shutter, whose line delay is ignored unless it is asked for. CPU seconds are those of the
command and its processes, on one thread each; poses are estimated once for all sections of a size.
Exit status 1 if a target is missed.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

from benchmarks.film.identities import people_right
from benchmarks.table import Row, print_rows
from stcalib_ros.core.evaluation.metrics import Evaluation, evaluate
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.results import read_result
from stcalib_ros.threads import use_one_thread

_FOLDER = Path("examples/film")
_TARGETS = {
    "given": {"E_R": 0.01, "E_t": 0.02, "offset": 0.2},
    "unknown": {"E_R": 0.02},
}
"""Largest errors: E_R in rad, E_t in distances of the first two cameras, offset in frames; those of
the project's goals for films."""
_LINE_DELAYS = ("ignored", "given", "estimated")
"""What is done about the rolling shutter."""
_FRAME_S = 1 / 15
"""Seconds. Period of most of the cameras."""


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.film.level",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--cameras", type=int, nargs="+", default=[4, 6], choices=(2, 3, 4, 5, 6))
    add("--intrinsics", nargs="+", default=list(_TARGETS), choices=list(_TARGETS))
    add("--line-delay", nargs="+", default=["ignored"], choices=_LINE_DELAYS)
    add("--input-size", nargs="+", default=["512"], help="of the estimator's images, px")
    add("--folder", type=Path, default=_FOLDER, help=f"with films and truth (default {_FOLDER})")
    add("--estimator", default="movenet")
    args = parser.parse_args(argv)
    use_one_thread()
    met = True
    with tempfile.TemporaryDirectory() as scratch:
        for n in args.cameras:
            for size in args.input_size:
                output = Path(scratch) / f"{n}-{size}.yaml"
                for lenses, shutter in product(args.intrinsics, args.line_delay):
                    rows = list(_rows(args, n, size, lenses, shutter, output))
                    title = (
                        f"{n} cameras, {args.estimator} at {size} px, intrinsics {lenses}, "
                        f"line delay {shutter}"
                    )
                    print_rows(title, rows, file=sys.stdout)
                    met &= all(row.met is not False for row in rows)
    return 0 if met else 1


def _rows(
    args: argparse.Namespace, n: int, size: str, lenses: str, shutter: str, output: Path
) -> Iterator[Row]:
    truth = read_result(args.folder / "truth.yaml")
    truth = replace(truth, cameras=truth.cameras[:n])
    before = _cpu_s()
    failed = _calibrate(args, truth, size, lenses, shutter, output)
    spent = _cpu_s() - before
    if failed:
        yield Row("result", failed, "", met=False)
        return
    result = read_result(output)
    output.unlink()
    yield from _errors(evaluate(result, truth), _TARGETS[lenses])
    right = people_right(result, read_bag(output.with_suffix(".mcap")), args.folder)
    yield Row(
        "people", f"{right} right of {len(result.persons)}", "all", right == len(result.persons)
    )
    yield Row("CPU", f"{spent:.0f} s", "", None)


def _errors(found: Evaluation, targets: dict[str, float]) -> Iterator[Row]:
    yield Row("cameras", f"{len(found.cameras)}", "all", met=not found.missing)
    offset = max(abs(camera.offset_s) for camera in found.cameras) / _FRAME_S
    for name, value, unit in (
        ("E_R", found.E_R, "rad"),
        ("E_t", found.E_t, ""),
        ("offset", offset, "frame, the largest"),
    ):
        most = targets.get(name)
        target = "" if most is None else f"<= {most:g}"
        yield Row(name, f"{value:.4f} {unit}", target, None if most is None else value <= most)


def _calibrate(
    args: argparse.Namespace, truth: Calibration, size: str, lenses: str, shutter: str, output: Path
) -> str:
    """Run the command; return what it says if it fails."""
    films = [str(args.folder / f"{camera.name}.mp4") for camera in truth.cameras]
    given = args.folder / "truth.yaml" if lenses == "given" else lenses
    options = ["--estimator", args.estimator, "--input-size", size, "--jobs", "1", "--quiet"]
    done = subprocess.run(
        [
            *(sys.executable, "-m", "stcalib_ros", "calibrate", *films, *options),
            *_shutter_options(truth, shutter),
            *("--intrinsics", str(given), "--output", str(output)),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stderr.strip().splitlines()[-1] if done.returncode else ""


def _shutter_options(truth: Calibration, shutter: str) -> Iterator[str]:
    if shutter == "estimated":
        yield "--estimate-line-time"
    for camera in truth.cameras if shutter == "given" else ():
        if camera.line_time_s:
            yield from ("--line-time", f"{camera.name}={camera.line_time_s}")


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    raise SystemExit(main())
