"""``stcalib convert``: from other people's files to a bag."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from stcalib_ros.commands.bag_and_truth import add_output_arguments, require_outputs, write_outputs
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.io.convert import convert_arrays, has_truth, recording_of_arrays
from stcalib_ros.io.convert_options import ConvertOptions
from stcalib_ros.io.datasets import DATASETS, DatasetOptions, read_dataset
from stcalib_ros.io.formats import FORMATS, recognise
from stcalib_ros.io.lens_files import lenses_of
from stcalib_ros.io.npz_files import read_npz
from stcalib_ros.io.sources import SOURCES, SourceOptions, part_of_source, read_source
from stcalib_ros.io.sources.recording import recording_of_source
from stcalib_ros.io.sources.tables import with_stamps
from stcalib_ros.io.sources.videos import with_videos

MAX_SEED = 2**63
"""Largest seed of random numbers, as of a simulated scene."""

MAX_NOISE_PX = 1e4
"""Pixels. Noise that is larger leaves nothing of a pose, as of a simulated scene."""

_SOURCE_OPTIONS = ("image_size", "intrinsics", "videos", "stamps")
_POSES = "\n".join(f"  {name:<12} {source.what}" for name, source in SOURCES.items())

DESCRIPTION = f"""\
Make a bag of the 2D poses that a pose estimator wrote, from a multi-view .npz file, or from a data
set in its official layout.

  stcalib convert openpose_output walk.mcap --fps 30 --image-size 1920x1080
  stcalib convert balance.npz balance.mcap --truth balance_truth.yaml --offset cam02=0.317
  stcalib convert 160906_pizza1 pizza.mcap --cameras 2,12,21,28 --truth t.yaml

What SOURCE is, is found by its content; --format overrides it. See docs/formats.md.
{_POSES}
  npz          multi-view arrays: camera_names, image_size, fps, frame_number; of each detection
               det_frame, det_camera, det_kp2d (x, y, score) with kp_names; if known, det_track,
               det_kp3d with kp3d_names (metres, camera axes), K, dist, and as the truth
               R, t (x_cam = R x_world + t) and det_person
  panoptic     the folder of a sequence: calibration_*.json, hdPose3d_stage1_coco19/
  easymocap    the folder of a scene (ZJU-MoCap): intri.yml, extri.yml, annots/, keypoints3d/
  mmptrack     the folder of a scene's labels, with ../../../calibrations beside it
The poses of the last three are those in --poses (POSES/CAMERA/alphapose-results.json of AlphaPose
with tracking and POSES/CAMERA/IDX/X3D.npy of MotionBERT; without the latter, 2D only), or the true
joints with noise (--sigma-px).
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("source", type=Path, metavar="SOURCE", help="file or folder, see above")
    add_output_arguments(parser)
    parser.add_argument(
        "--format",
        choices=FORMATS,
        metavar="NAME",
        help="what SOURCE is (default: found by its content)",
    )
    _add_source_arguments(parser)
    _add_dataset_arguments(parser)
    parser.add_argument(
        "--offset",
        type=_camera_offset,
        action="append",
        default=[],
        metavar="CAM=S",
        help="add S seconds to the stamps of camera CAM, whose true time_offset_s is then S lower; "
        "no frames are cut; may be repeated",
    )
    parser.add_argument("--fps", type=float, metavar="HZ", help="frame rate (default: the file's)")
    parser.add_argument(
        "--layout", metavar="NAME", help="joint layout (default: found by the names of the joints)"
    )


def run(args: argparse.Namespace) -> None:
    """Convert.

    Raises
    ------
    InputError
        The source or an argument is unusable.
    """
    require_outputs(args)
    name = args.format or recognise(args.source)
    recording, truth = _converted(name, args)
    if args.truth is not None and truth is None:
        raise InputError(f"--truth: {args.source} has no true poses of its cameras; leave it out")
    write_outputs(args, recording, truth)
    if truth is None:
        print_source(name, recording, args.output)


def _add_source_arguments(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("poses of an estimator")
    group.add_argument(
        "--image-size",
        type=_image_size,
        metavar="WxH",
        help="size of the images, px, where SOURCE does not say",
    )
    group.add_argument(
        "--intrinsics",
        type=Path,
        metavar="FILE",
        help="lenses: camera_info YAML, Kalibr, OpenCV, TOML, COLMAP, or a folder of them "
        "(default: those in SOURCE, or none: calibrate with --intrinsics unknown)",
    )
    group.add_argument(
        "--videos",
        type=Path,
        metavar="DIR",
        help="folder of the videos, CAMERA.mp4, which say frame rate and size",
    )
    group.add_argument(
        "--stamps",
        type=Path,
        metavar="FILE.csv",
        help="time of each image: columns camera, frame, stamp; or a folder of CAMERA.csv",
    )


def _add_dataset_arguments(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("data sets")
    group.add_argument(
        "--cameras", metavar="A,B,...", help="their names or numbers, in this order (default: all)"
    )
    group.add_argument(
        "--frames", type=_frame_range, metavar="FIRST:LAST", help="frames by the data set's numbers"
    )
    group.add_argument(
        "--poses", type=Path, metavar="DIR", help="poses of AlphaPose, and of MotionBERT"
    )
    group.add_argument(
        "--sigma-px", type=float, metavar="PX", help="noise of the true joints (default: 3)"
    )
    group.add_argument("--seed", type=int, help="of that noise (default: 0)")


def _converted(name: str, args: argparse.Namespace) -> tuple[Recording, Calibration | None]:
    options = ConvertOptions(dict(args.offset), args.fps, args.layout)
    if name in DATASETS:
        arrays = read_dataset(name, args.source, _dataset_options(args))
        return convert_arrays(args.source, arrays, options)
    _refuse(args, name, ("poses", "sigma_px", "seed"), "data sets")
    if name != "npz":
        return _recording(name, args, options), None
    _refuse(args, name, ("cameras", "frames", *_SOURCE_OPTIONS), "other formats")
    arrays = read_npz(args.source)
    if has_truth(arrays):
        return convert_arrays(args.source, arrays, options)
    return recording_of_arrays(args.source, arrays, options), None


def _recording(name: str, args: argparse.Namespace, options: ConvertOptions) -> Recording:
    wanted = args.cameras.split(",") if args.cameras else None
    source = part_of_source(read_source(name, args.source), wanted, None)
    if args.videos is not None:
        source = replace(source, cameras=with_videos(source.cameras, args.videos))
    if args.stamps is not None:
        source = with_stamps(source, args.stamps)
    names = [camera.name for camera in source.cameras]
    lenses = {}
    if args.intrinsics is not None:
        lenses = lenses_of(args.intrinsics, names, image_size=args.image_size)
    source = part_of_source(source, None, args.frames)
    return recording_of_source(source, options, SourceOptions(args.image_size, lenses))


def _refuse(args: argparse.Namespace, name: str, options: tuple[str, ...], of: str) -> None:
    """Refuse options that say nothing about a format."""
    if given := [option for option in options if getattr(args, option) is not None]:
        flag = f"--{given[0].replace('_', '-')}"
        raise InputError(f"{flag} is for {of}, but {args.source} is read as {name}")


def _dataset_options(args: argparse.Namespace) -> DatasetOptions:
    _refuse(args, args.format or "a data set", _SOURCE_OPTIONS, "poses of an estimator")
    first, last = args.frames or (None, None)
    given = {
        "cameras": tuple(args.cameras.split(",")) if args.cameras else None,
        "first": first,
        "last": last,
        "poses": args.poses,
        "sigma_px": args.sigma_px,
        "seed": args.seed,
    }
    given = {name: value for name, value in given.items() if value is not None}
    seed, sigma_px = given.get("seed", 0), given.get("sigma_px", 0.0)
    if not (0 <= seed <= MAX_SEED and 0 <= sigma_px <= MAX_NOISE_PX):
        raise InputError(
            f"--seed must be 0 to {MAX_SEED} and --sigma-px 0 to {MAX_NOISE_PX:g}, got "
            f"{seed} and {sigma_px}"
        )
    return DatasetOptions(**given)


def print_source(name: str, recording: Recording, output: Path) -> None:
    """Say what was found in a source, and what to do next."""
    print(f"Read as {name}:")
    for camera in recording.cameras:
        poses = sum(len(track.frames) for track in camera.tracks)
        size = f"{camera.intrinsics.width} x {camera.intrinsics.height} px"
        lens = size if camera.intrinsics.known else f"{size}, lens unknown"
        tracked = 0 < len(camera.tracks) < poses
        ids = f"{len(camera.tracks)} ids" if tracked else "no ids"
        print(
            f"  {camera.name:<12} {len(camera.stamps)} images, {poses} poses "
            f"({camera.layout.name}), {ids}, {lens}"
        )
    if len(recording.cameras) == 1:
        print("One camera alone cannot be calibrated: name the folder that has all of them")
        return
    known = all(camera.intrinsics.known for camera in recording.cameras)
    unknown = "" if known else " --intrinsics unknown"
    print(f"Next: stcalib calibrate {output} --output {output.stem}.yaml{unknown}")


def _image_size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT, as in 1920x1080, got {text!r}")
    return int(width), int(height)


def _frame_range(text: str) -> tuple[int, int]:
    first, _, last = text.partition(":")
    if not first.isdecimal() or not last.isdecimal() or int(last) < int(first):
        raise argparse.ArgumentTypeError(f"expected FIRST:LAST, as in 300:599, got {text!r}")
    return int(first), int(last)


def _camera_offset(text: str) -> tuple[str, float]:
    camera, _, seconds = text.rpartition("=")
    try:
        number = float(seconds)
    except ValueError:
        camera = ""
    if not camera:
        raise argparse.ArgumentTypeError(f"expected CAM=SECONDS, as in cam02=0.317, got {text!r}")
    return camera, number
