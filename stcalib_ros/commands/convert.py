"""``stcalib convert``: from other people's files to a bag."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from stcalib_ros.commands.bag_and_truth import (
    add_output_arguments,
    require_outputs,
    write_outputs,
    written_plain,
    written_text,
)
from stcalib_ros.commands.pose_file_arguments import (
    ESTIMATOR_OPTIONS,
    add_pose_file_arguments,
    refuse_options,
)
from stcalib_ros.commands.pose_files import format_of, read_arrays, read_pose_files
from stcalib_ros.commands.terminal import tell
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.io.convert import convert_arrays, has_truth
from stcalib_ros.io.convert_options import ConvertOptions
from stcalib_ros.io.datasets import DATASETS, DatasetOptions, read_dataset
from stcalib_ros.io.sources import SOURCES
from stcalib_ros.io.sources.cameras import plain_name

MAX_SEED = 2**63
"""Largest seed of random numbers, as of a simulated scene."""

MAX_NOISE_PX = 1e4
"""Pixels. Noise that is larger leaves nothing of a pose, as of a simulated scene."""

_POSES = "\n".join(f"  {name:<12} {source.what}" for name, source in SOURCES.items())

DESCRIPTION = f"""\
Make a bag from the 2D poses that a pose estimator wrote, from a multi-view .npz file, or from a
data set in its official layout.

  stcalib convert openpose_output walk.mcap --fps 30 --image-size 1920x1080
  stcalib convert balance.npz balance.mcap --truth balance_truth.yaml --offset cam02=0.317
  stcalib convert 160906_pizza1 pizza.mcap --cameras 2,12,21,28 --truth t.yaml

The format of SOURCE is recognised by its content; --format overrides it. See docs/formats.md.
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
    add_pose_file_arguments(parser)
    parser.add_argument(
        "--intrinsics",
        type=Path,
        metavar="FILE",
        help="lenses: camera_info YAML, Kalibr, OpenCV, TOML, COLMAP, or a folder of them "
        "(default: those in SOURCE, or none: calibrate with --intrinsics unknown)",
    )
    _add_dataset_arguments(parser)
    parser.add_argument(
        "--offset",
        type=_camera_offset,
        action="append",
        default=[],
        metavar="CAM=S",
        help="add S seconds to the timestamps of camera CAM, so that its true time_offset_s is S "
        "less; no frames are removed; may be repeated",
    )


def run(args: argparse.Namespace) -> None:
    """Convert.

    Raises
    ------
    InputError
        The source or an argument is unusable.
    """
    require_outputs(args)
    name = format_of(args.source, args.format)
    recording, truth = _converted(name, args)
    if args.truth is not None and truth is None:
        raise InputError(f"--truth: {args.source} has no true poses of its cameras; leave it out")
    write_outputs(args, recording, truth)
    text = written_text(args, recording)
    if truth is None:
        text += "\n" + source_text(name, recording, args.output, args.source)
    tell(args, text, {"format": name, **written_plain(args, recording)})


def _add_dataset_arguments(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("data sets")
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
    why = f"is for data sets, but {args.source} is read as {name}"
    refuse_options(args, ("poses", "sigma_px", "seed"), why)
    if name == "npz":
        arrays = read_arrays(args.source, args, args.intrinsics)
        if has_truth(arrays):
            return convert_arrays(args.source, arrays, options)
    return read_pose_files(name, args.source, args, options, args.intrinsics), None


def _dataset_options(args: argparse.Namespace) -> DatasetOptions:
    why = f"is for poses of an estimator, but {args.source} is a data set"
    refuse_options(args, ("intrinsics", *ESTIMATOR_OPTIONS), why)
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


def source_text(name: str, recording: Recording, output: Path, source: Path | None = None) -> str:
    """Say what was found in a source, and what to do next; `source` may be a folder of several."""
    lines = [f"Read as {name}:"]
    for camera in recording.cameras:
        poses = sum(len(track.frames) for track in camera.tracks)
        size = f"{camera.intrinsics.width} x {camera.intrinsics.height} px"
        lens = size if camera.intrinsics.known else f"{size}, lens unknown"
        tracked = 0 < len(camera.tracks) < poses
        ids = f"{len(camera.tracks)} ids" if tracked else "no ids"
        lines.append(
            f"  {camera.name:<12} {len(camera.stamps)} images, {poses} poses "
            f"({camera.layout.name}), {ids}, {lens}"
        )
    if len(recording.cameras) == 1:
        lines.append("One camera alone cannot be calibrated: name the folder that has all of them")
        return "\n".join(lines)
    names = [camera.name for camera in recording.cameras]
    if source is not None and (folders := _recordings_of_the_same(source, names)):
        lines.append(
            f"Cameras in {' and '.join(folders)} have the same names: if these are recordings of "
            f"the same cameras, convert one of them, {source / folders[0]}"
        )
    known = all(camera.intrinsics.known for camera in recording.cameras)
    unknown = "" if known else " --intrinsics unknown"
    lines.append(f"Next: stcalib calibrate {output} --output {output.stem}.yaml{unknown}")
    return "\n".join(lines)


def _recordings_of_the_same(source: Path, names: Sequence[str]) -> list[str]:
    """Return folders in each of which there are the same cameras, or none if there is one."""
    cameras: dict[str, set[str]] = {}
    for folder in sorted(source.iterdir()) if source.is_dir() else ():
        begin = f"{plain_name(folder.name)}_"
        if own := {name.removeprefix(begin) for name in names if name.startswith(begin)}:
            cameras[folder.name] = own
    first = next(iter(cameras.values()), set())
    same = len(cameras) > 1 and len(first) > 1 and all(own == first for own in cameras.values())
    return list(cameras) if same else []


def _camera_offset(text: str) -> tuple[str, float]:
    camera, _, seconds = text.rpartition("=")
    try:
        number = float(seconds)
    except ValueError:
        camera = ""
    if not camera:
        raise argparse.ArgumentTypeError(f"expected CAM=SECONDS, as in cam02=0.317, got {text!r}")
    return camera, number
