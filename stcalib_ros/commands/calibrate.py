"""``stcalib calibrate``: from a bag to a result file."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from stcalib_ros.commands.film_arguments import add_film_arguments, bag_of, named_path
from stcalib_ros.commands.jobs import count, processes
from stcalib_ros.core.errors import CalibrationError, InputError

if TYPE_CHECKING:
    from stcalib_ros.core.model.calibration import Calibration
    from stcalib_ros.core.model.lens_knowledge import LensKnowledge
    from stcalib_ros.core.model.recording import Recording
    from stcalib_ros.core.options import Options
    from stcalib_ros.core.stages import Stages
    from stcalib_ros.io.config import Config
    from stcalib_ros.io.topics import CameraSelection

# What computes is imported by the functions that need it, for `--help` to be quick.

DESCRIPTION = """\
Find where cameras are, how their clocks differ and who is who, from the people in a bag.

  stcalib calibrate walk.mcap --output walk.yaml

The bag holds for every camera
  /<camera>/person_poses  stcalib_ros/msg/PersonPose3DArray
  /<camera>/camera_info   sensor_msgs/msg/CameraInfo
or poses of yolo_ros, ZED, Azure Kinect, ROS4HRI or Hi-ROS. BAG may also be films, one per camera:

  stcalib calibrate cam0.mp4 cam1.mp4 cam2.mp4 --output walk.yaml --intrinsics lenses.yaml

Poses are then written to walk.mcap first, as by `stcalib estimate`; later runs use that bag.

Poses in OUT.yaml are T_ref_cam: the camera in the frame of the reference camera. Add the offset of
a camera to its timestamps to have the reference clock: t_ref = t_cam + time_offset_s. With a
rolling shutter, row v of an image is taken at stamp + line_time_s * v. If the result cannot be
trusted, OUT.yaml is not written; OUT.rejected.yaml shows what was found, and is not to be used.
"""

_CONFIG_HELP = """\
YAML file with options by name (offset_range_s: 1.0), the cameras and their order
(cameras: [cam0, cam1]), topics and frames that differ from the above
(camera: {cam0: {pose_topic: /a, info_topic: /b, frame: c, line_time_s: 15.0e-6}}), and lenses
(camera: {cam0: {intrinsics: refine, lens_group: gopro, field_of_view_deg: 90}})"""

_ALIGN_HELP = """\
for clocks that differ by more than --offset-range, such as UTC and the time since boot: what to
add to timestamps first. starts: as if all cameras had started together; stamps: nothing; S:
seconds, for all cameras but the reference; CAM=S,...: seconds for these cameras. Default: nothing,
or a guess if cameras do not overlap in time, which the result states. Time offsets include it"""

_INTRINSICS_HELP = """\
how far to trust the intrinsics in CameraInfo: given (they are right, the default), refine (start
from them) or unknown (use the image size only); with CAM=, for one camera. Or a file or folder with
lenses to use instead of CameraInfo: camera_info YAML, Kalibr camchain, OpenCV YAML, XML, JSON or
npz, TOML of aniposelib, Pose2Sim and Caliscope, COLMAP cameras.txt. May be repeated"""


def add_arguments(parser: argparse.ArgumentParser, *, output_required: bool = True) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        "source",
        nargs="+",
        type=named_path,
        metavar="BAG",
        help=".mcap file or rosbag2 folder; or films, [CAM=]FILM of each camera, or their folder",
    )
    parser.add_argument(
        *("-o", "--output"),
        type=Path,
        required=output_required,
        metavar="OUT.yaml",
        help="result file to write",
    )
    _add_further_outputs(parser)
    add_option_arguments(parser)
    parser.add_argument(
        "--jobs",
        type=count,
        default=1,
        metavar="N",
        help="number of processes for films and camera pairs; same result (default: 1)",
    )
    add_film_arguments(parser.add_argument_group("films"))


def _add_further_outputs(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--report",
        type=Path,
        metavar="OUT.html",
        help="also write the report, as `stcalib report` does",
    )
    parser.add_argument(
        "--people",
        type=Path,
        metavar="OUT.{trc,npz,mcap}",
        help="also write the people in 3D, as `stcalib people` does",
    )
    parser.add_argument(
        "--write-camera-info",
        type=Path,
        metavar="FOLDER",
        help="also write the intrinsics, a CAM.yaml per camera for camera_info_manager",
    )


def add_option_arguments(parser: argparse.ArgumentParser) -> None:
    """Add those that are options of the calibration, too."""
    parser.add_argument("-c", "--config", type=Path, metavar="FILE", help=_CONFIG_HELP)
    parser.add_argument(
        "--reference",
        metavar="CAM",
        help="camera whose frame and clock are the reference (default: the first)",
    )
    parser.add_argument(
        "--offset-range",
        type=float,
        metavar="S",
        help="largest time offset to search for, in seconds (default: 2)",
    )
    parser.add_argument("--align", metavar="{starts,stamps,S,CAM=S,...}", help=_ALIGN_HELP)
    parser.add_argument(
        "--intrinsics",
        type=_intrinsics,
        action="append",
        default=[],
        metavar="[CAM=]{given,refine,unknown,FILE[:NAME]}",
        help=_INTRINSICS_HELP,
    )
    _add_shutter_arguments(parser)
    parser.add_argument("--seed", type=int, metavar="N", help="random seed (default: 0)")


def _add_shutter_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--line-time",
        type=_line_time,
        action="append",
        default=[],
        metavar="CAM=S",
        help="rolling shutter of a camera: S seconds per image row, as cam0=15e-6; may be repeated",
    )
    parser.add_argument(
        "--estimate-line-time",
        action="store_true",
        help="estimate the seconds per image row of rolling shutters",
    )


def run(args: argparse.Namespace) -> tuple[Recording, Calibration]:
    """Calibrate; returns what was recorded, and a result that can be trusted.

    `args.bag` is the bag then, also where films were given.

    Raises
    ------
    InputError
        An argument or file is unusable.
    CalibrationError
        No trustworthy calibration can be had.
    """
    from stcalib_ros.commands.terminal import ProgressPrinter, calibration_text
    from stcalib_ros.core.model.calibration import Status
    from stcalib_ros.core.pipeline import run_stages
    from stcalib_ros.io.bag import read_bag
    from stcalib_ros.io.camera_info_yaml import write_camera_info
    from stcalib_ros.io.results import result_json

    _require_outputs(args)
    config = config_of(args)
    args.bag = bag_of(args)
    progress = ProgressPrinter(None if args.quiet else sys.stderr, verbose=args.verbose)
    try:
        recording = read_bag(
            args.bag,
            selection=config.selection,
            progress=progress,
            decoder=args.decoder,
            warn=progress.warn,
        )
        with processes(args.jobs) as executor:
            stages = run_stages(recording, config.options, progress=progress, executor=executor)
    finally:
        progress.close()
    written = [_write(stages.calibration, args.output)]
    if args.report is not None:
        written.append(_write_report(recording, stages, config.options, args.report))
    if args.json:
        print(result_json(stages.calibration))
    if stages.calibration.status is not Status.OK:
        raise CalibrationError(_refusal(stages.calibration, written))
    if args.write_camera_info is not None:
        write_camera_info(stages.calibration, args.write_camera_info)
        written.append(args.write_camera_info)
    if args.people is not None:
        written += _write_people(recording, stages, args)
    if not (args.quiet or args.json):
        print(calibration_text(stages.calibration))
        print(f"\nWritten to {' and '.join(map(str, filter(None, written)))}")
    return recording, stages.calibration


def _require_outputs(args: argparse.Namespace) -> None:
    """Make sure that all files can be written."""
    from stcalib_ros.commands.report import require_report
    from stcalib_ros.io.camera_info_yaml import require_camera_info_writable
    from stcalib_ros.io.files import require_writable
    from stcalib_ros.io.people_files import require_people_writable

    require_writable(args.output)
    if args.people is not None:
        require_people_writable(args.people)
    if args.report is not None:
        require_report(args.report)
    if args.write_camera_info is not None:
        require_camera_info_writable((), args.write_camera_info)


def config_of(args: argparse.Namespace) -> Config:
    """Read the configuration file; arguments take precedence."""
    from stcalib_ros.core.model.lens_knowledge import LensKnowledge
    from stcalib_ros.io.config import Config, read_config

    config = Config() if args.config is None else read_config(args.config)
    given = {"reference": args.reference, "offset_range_s": args.offset_range}
    given |= {"seed": args.seed, "align": args.align}
    changes = {name: value for name, value in given.items() if value is not None}
    if args.estimate_line_time:
        changes["estimate_line_time"] = True
    selection = config.selection.with_line_delays(dict(args.line_time))
    for name, worth in args.intrinsics:
        if isinstance(worth, Path):
            selection = _with_file(selection, name, worth)
        elif name:
            selection = selection.with_lens(name, knowledge=worth)
        else:
            changes["intrinsics"] = worth.value
    if selection.lens_file is not None and "intrinsics" in changes:
        worth = LensKnowledge(changes["intrinsics"])
        selection = replace(selection, lens_file=replace(selection.lens_file, knowledge=worth))
    return Config(replace(config.options, **changes), selection)


def _with_file(selection: CameraSelection, name: str, file: Path) -> CameraSelection:
    """The same with a file of lenses: of a camera, of a group of cameras, or of all (no name)."""
    from stcalib_ros.io.lens_files import read_lens_fields, read_lens_of
    from stcalib_ros.io.lens_settings import LensFile

    if not name:
        return replace(selection, lens_file=LensFile(str(file), read_lens_fields(file)))
    group = [camera for camera, own in selection.camera.items() if own.lens.group == name]
    for camera in group if group and name not in selection.camera else [name]:
        selection = selection.with_lens(camera, info=read_lens_of(str(file), camera))
    return selection


def _intrinsics(text: str) -> tuple[str, LensKnowledge | Path]:
    """Camera, empty for all, and what its intrinsics are worth, or the file that has them."""
    from stcalib_ros.core.model.lens_knowledge import lens_knowledge

    name, equals, worth = text.rpartition("=")
    if equals and not (name and worth):
        raise argparse.ArgumentTypeError(f"expected CAM={worth or 'FILE'}, got {text!r}")
    if {".", "/"} & set(worth) or Path(worth).exists():
        return name, Path(worth)
    try:
        return name, lens_knowledge(worth, name or "all cameras")
    except InputError as error:
        raise argparse.ArgumentTypeError(f"{error}, and there is no such file") from None


def _line_time(text: str) -> tuple[str, float]:
    """Camera and seconds per row."""
    name, _, seconds = text.rpartition("=")
    if not name:
        raise argparse.ArgumentTypeError(f"expected CAM=SECONDS, got {text!r}")
    try:
        return name, float(seconds)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"expected seconds per image row after {name}=, got {seconds!r}"
        ) from None


def _write(calibration: Calibration, output: Path) -> Path | None:
    """Write the result; one that is not to be used under another name, and only if it has poses."""
    from stcalib_ros.core.model.calibration import Status
    from stcalib_ros.io.results import write_result

    if calibration.status is not Status.OK:
        output = output.with_name(f"{output.stem}.rejected{output.suffix}")
    if not calibration.cameras:
        return None
    write_result(calibration, output)
    return output


def _write_report(recording: Recording, stages: Stages, options: Options, path: Path) -> Path:
    from stcalib_ros.report.content import content_of_stages
    from stcalib_ros.report.html import write_report

    write_report(content_of_stages(recording, stages, options), path)
    return path


def _write_people(
    recording: Recording, stages: Stages, args: argparse.Namespace
) -> tuple[Path, ...]:
    from stcalib_ros.commands.people import write

    return write(stages.calibration, stages.trajectories(), recording, args.people)


def _refusal(calibration: Calibration, written: Sequence[Path | None]) -> str:
    """Why there is no calibration, and where to look."""
    problem = f"no trustworthy calibration ({calibration.status.name}): {calibration.message}"
    found, *reports = written
    if found is not None:
        problem += f" (what was found, not to be used, is in {found})"
    return problem + "".join(f" (report: {path})" for path in reports)
