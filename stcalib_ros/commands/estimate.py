"""``stcalib estimate``: from films to a bag with the poses of the people in them."""

from __future__ import annotations

import argparse
from pathlib import Path

from stcalib_ros.commands.film_arguments import (
    add_film_arguments,
    clocks_text,
    named_path,
    poses_of_films,
)
from stcalib_ros.commands.jobs import count

# What computes is imported by the functions that need it, for `--help` to be quick.

DESCRIPTION = """\
Find the people in films, and write their poses as a bag.

  stcalib estimate cam0.mp4 cam1.mp4 cam2.mp4 --output walk.mcap
  stcalib calibrate walk.mcap --output walk.yaml --intrinsics lenses.yaml

One film of each camera, of the same people at the same time; clocks need not agree, and no film
has to be cut. `stcalib calibrate cam0.mp4 ... --output walk.yaml` does both in one command.
Poses are kept beside the output, in OUT.parts, until all are there: after Ctrl-C, the same command
goes on where it was.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        "films",
        nargs="+",
        type=named_path,
        metavar="[CAM=]FILM",
        help="a film of each camera, named by its file unless CAM= does; or a folder with them",
    )
    parser.add_argument(
        *("-o", "--output"),
        type=Path,
        required=True,
        metavar="OUT.mcap",
        help="bag to write: a file that ends in .mcap, else a rosbag2 folder",
    )
    add_film_arguments(parser)
    parser.add_argument(
        "--intrinsics",
        type=Path,
        metavar="FILE",
        help="lenses: camera_info YAML, Kalibr, OpenCV, TOML, COLMAP, or a folder of them "
        "(default: none; they can be given to `stcalib calibrate`, too)",
    )
    parser.add_argument(
        "--jobs",
        type=count,
        default=2,
        metavar="N",
        help="processes, each of which takes a film (default: 2)",
    )
    parser.add_argument("-q", "--quiet", action="store_true", help="print warnings and errors only")


def run(args: argparse.Namespace) -> None:
    """Estimate poses, and write them.

    Raises
    ------
    InputError
        A film or an argument is unusable.
    """
    from stcalib_ros.commands.convert import print_source
    from stcalib_ros.io.bag_writer import require_bag_writable
    from stcalib_ros.io.film_files import films_by_camera
    from stcalib_ros.io.lens_files import lenses_of

    require_bag_writable(args.output)
    films = films_by_camera(args.films)
    lenses = {} if args.intrinsics is None else lenses_of(args.intrinsics, list(films))
    recording = poses_of_films(args, films, args.output, lenses=lenses)
    if not args.quiet:
        print(clocks_text(films))
        print_source("films", recording, args.output)
