"""``stcalib doctor``: what is in a bag, and whether it will calibrate."""

from __future__ import annotations

import argparse
from pathlib import Path

from stcalib_ros.commands.calibrate import add_option_arguments, config_of
from stcalib_ros.core.errors import CalibrationError, InputError

# What computes is imported by the functions that need it, for `--help` to be quick.

DESCRIPTION = """\
Say what is in a bag, and predict whether it will calibrate: before anything is solved.

  stcalib doctor walk.mcap

Of every camera: images, rate, gaps, clock, lens, people, ids, how much of the image people cover,
and whether 3D poses agree with keypoints. Of every two cameras: the people that both see. The
checks of the input are those of `stcalib calibrate`, with the same options.

The prediction is 0 will calibrate, 3 will not (the reasons on stderr), 2 unusable, as the exit
status of `stcalib calibrate` would be.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("bag", type=Path, metavar="BAG", help=".mcap file or rosbag2 folder")
    add_option_arguments(parser)


def run(args: argparse.Namespace) -> None:
    """Print what is in a bag, and what is expected of it.

    Raises
    ------
    InputError
        An argument, the file or every camera in it is unusable.
    CalibrationError
        It will not calibrate.
    """
    from stcalib_ros.commands.doctor_text import diagnosis_json, diagnosis_text, verdict
    from stcalib_ros.core.diagnosis.examine import examine
    from stcalib_ros.io.bag import read_bag

    config = config_of(args)
    warnings: list[str] = []
    recording = read_bag(
        args.bag, selection=config.selection, decoder=args.decoder, warn=warnings.append
    )
    found = examine(recording, config.options)
    if args.json:
        print(diagnosis_json(found, warnings))
    else:
        print(diagnosis_text(found, str(args.bag), warnings))
    if found.unusable:
        raise InputError(found.unusable)
    if not found.will_calibrate:
        raise CalibrationError(verdict(found))
