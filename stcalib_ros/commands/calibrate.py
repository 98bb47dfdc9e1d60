"""``stcalib calibrate``: from a bag to a result file."""

from __future__ import annotations

import argparse
import importlib
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

from stcalib_ros.commands.terminal import ProgressPrinter, calibration_text
from stcalib_ros.core.errors import CalibrationError, InputError
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.types import Calibration, Status
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.config import Config, read_config
from stcalib_ros.io.files import require_writable
from stcalib_ros.io.results import write_result

DESCRIPTION = """\
Find camera poses, clock offsets and identities from the people in a bag.

  stcalib calibrate walk.mcap --output walk.yaml

The bag holds for every camera
  /<camera>/person_poses  stcalib_ros/msg/PersonPose3DArray
  /<camera>/camera_info   sensor_msgs/msg/CameraInfo

Poses in OUT.yaml are T_ref_cam: the camera in the frame of the reference camera. Offsets are what
to add to the stamps of a camera: t_ref = t_cam + time_offset_s. If the result cannot be trusted,
OUT.yaml is not touched; what was found is then kept as OUT.rejected.yaml, to be looked at.
"""

_CONFIG_HELP = """\
YAML file with options by name (offset_range_s: 1.0), which cameras in which order
(cameras: [cam0, cam1]), and topics and frames that differ from the above
(camera: {cam0: {pose_topic: /a, info_topic: /b, frame: c}})"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("bag", type=Path, metavar="BAG", help=".mcap file or rosbag2 folder")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="OUT.yaml", help="result file to write"
    )
    parser.add_argument("-c", "--config", type=Path, metavar="FILE", help=_CONFIG_HELP)
    parser.add_argument(
        "--report", type=Path, metavar="OUT.html", help="also write a report with pictures"
    )
    parser.add_argument(
        "--reference",
        metavar="CAM",
        help="camera that gives the reference frame and clock (default: the first)",
    )
    parser.add_argument(
        "--offset-range",
        type=float,
        metavar="S",
        help="clocks are searched within plus and minus S seconds (default: 2)",
    )
    parser.add_argument("--seed", type=int, metavar="N", help="same seed, same result (default: 0)")
    parser.add_argument("-q", "--quiet", action="store_true", help="print warnings and errors only")


def run(args: argparse.Namespace) -> None:
    """Calibrate.

    Raises
    ------
    InputError
        An argument or file is unusable.
    CalibrationError
        No trustworthy calibration can be had.
    """
    require_writable(args.output)
    report = None
    if args.report is not None:
        require_writable(args.report)
        report = _report_module()
    config = _config(args)
    progress = ProgressPrinter(None if args.quiet else sys.stderr)
    try:
        recording = read_bag(
            args.bag,
            selection=config.selection,
            progress=progress,
            decoder=args.decoder,
            warn=progress.warn,
        )
        calibration = calibrate(recording, config.options, progress=progress)
    finally:
        progress.close()
    if calibration.status is not Status.OK:
        _reject(calibration, args.output)
    write_result(calibration, args.output)
    if report is not None:
        report.write_report(recording, calibration, args.report)
    if not args.quiet:
        print(calibration_text(calibration))
        print(f"\nWritten to {args.output}")


def _config(args: argparse.Namespace) -> Config:
    """Read the configuration file; arguments take precedence."""
    config = Config() if args.config is None else read_config(args.config)
    given = {"reference": args.reference, "offset_range_s": args.offset_range, "seed": args.seed}
    changes = {name: value for name, value in given.items() if value is not None}
    return replace(config, options=replace(config.options, **changes))


def _reject(calibration: Calibration, output: Path) -> None:
    """Keep what was found under another name, and say why it is not to be used."""
    problem = f"no trustworthy calibration ({calibration.status.name}): {calibration.message}"
    if calibration.cameras:
        rejected = output.with_name(f"{output.stem}.rejected{output.suffix}")
        write_result(calibration, rejected)
        problem += f" (what was found, not to be used, is in {rejected})"
    raise CalibrationError(problem)


def _report_module() -> ModuleType:
    try:
        return importlib.import_module("stcalib_ros.report.html")
    except ModuleNotFoundError as error:
        raise InputError(
            f"--report needs {error.name}: pip install 'stcalib-ros[report]'"
        ) from error
