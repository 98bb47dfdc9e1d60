"""``stcalib doctor``: what is in a bag, and whether it will calibrate."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, NamedTuple

from stcalib_ros.commands.calibrate import add_option_arguments, config_of
from stcalib_ros.commands.pose_file_arguments import (
    POSE_FILE_OPTIONS,
    add_pose_file_arguments,
    refuse_options,
)
from stcalib_ros.core.errors import CalibrationError, InputError

if TYPE_CHECKING:
    from stcalib_ros.core.model.recording import Recording
    from stcalib_ros.io.config import Config

# What computes is imported by the functions that need it, for `--help` to be quick.

_POSE_FILES = (".npz", ".json", ".csv")
"""Endings of single files that are no bags."""

DESCRIPTION = """\
Show what is in a bag, and predict in seconds whether it will calibrate.

  stcalib doctor walk.mcap
  stcalib doctor openpose_output --fps 30 --image-size 1920x1080

SOURCE is a bag, or any file or folder that `stcalib convert` reads; for the latter, unknown lenses
are estimated.

For every camera it shows images, frame rate, gaps, clock, lens, people, track ids, how much of the
image people cover, and whether 3D poses agree with keypoints; for every two cameras, the people
whom both see. The input is checked as by `stcalib calibrate`, with the same options.

The exit status is the one to expect of `stcalib calibrate`: 0 will calibrate, 3 will not (the
reasons are on stderr), 2 unusable.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        "source", type=Path, metavar="SOURCE", help=".mcap file, rosbag2 folder, or see above"
    )
    add_option_arguments(parser)
    add_pose_file_arguments(parser)


def run(args: argparse.Namespace) -> None:
    """Print what is in a bag, and what is expected of it.

    Raises
    ------
    InputError
        An argument, the file or every camera in it is unusable.
    CalibrationError
        It will not calibrate.
    """
    from stcalib_ros.commands.doctor_text import diagnosis_plain, diagnosis_text, verdict
    from stcalib_ros.commands.terminal import tell
    from stcalib_ros.core.diagnosis.examine import examine

    warnings: list[str] = []
    what, recording, config = _read_source(args, warnings.append)
    found = examine(recording, config.options)
    tell(args, diagnosis_text(found, what, warnings), diagnosis_plain(found, warnings))
    if found.unusable:
        raise InputError(found.unusable)
    if not found.will_calibrate:
        raise CalibrationError(verdict(found))


class _Source(NamedTuple):
    """What the source is, what was recorded, and how it is to be calibrated."""

    what: str
    recording: Recording
    config: Config


def _read_source(args: argparse.Namespace, warn: Callable[[str], None]) -> _Source:
    if not args.source.exists():
        raise InputError(f"no such file or folder: {args.source}")
    if args.format is not None or _is_pose_files(args.source):
        with TemporaryDirectory() as folder:
            return _read_by_a_bag(args, Path(folder) / "walk.mcap", warn)
    why = f"is for poses in the files of other programs, but {args.source} is a bag"
    refuse_options(args, POSE_FILE_OPTIONS, why)
    config = config_of(args)
    return _Source(str(args.source), _read_bag(args, config, args.source, warn), config)


def _is_pose_files(source: Path) -> bool:
    from stcalib_ros.io.bag_files import is_bag_folder

    if source.is_dir():
        return not is_bag_folder(source)
    return source.suffix.lower() in _POSE_FILES


def _read_by_a_bag(args: argparse.Namespace, bag: Path, warn: Callable[[str], None]) -> _Source:
    """Do what the two commands do, so that all options mean the same: convert, and read that."""
    from stcalib_ros.commands.pose_files import format_of, read_pose_files
    from stcalib_ros.core.model.lens_knowledge import LensKnowledge
    from stcalib_ros.io.bag_writer import write_bag
    from stcalib_ros.io.convert_options import ConvertOptions

    lenses = [worth for name, worth in args.intrinsics if not name and isinstance(worth, Path)]
    options = ConvertOptions(fps=args.fps, layout=args.layout)
    name = format_of(args.source, args.format)
    recording = read_pose_files(name, args.source, args, options, lenses[-1] if lenses else None)
    write_bag(recording, bag)
    if not (args.intrinsics or all(camera.intrinsics.known for camera in recording.cameras)):
        args.intrinsics = [("", LensKnowledge.UNKNOWN)]
    config = config_of(args)
    return _Source(f"{args.source}, read as {name}", _read_bag(args, config, bag, warn), config)


def _read_bag(
    args: argparse.Namespace, config: Config, bag: Path, warn: Callable[[str], None]
) -> Recording:
    from stcalib_ros.io.bag import read_bag

    return read_bag(bag, selection=config.selection, decoder=args.decoder, warn=warn)
