"""``stcalib convert``: from other people's files to a bag."""

from __future__ import annotations

import argparse
from pathlib import Path

from stcalib_ros.commands.bag_and_truth import add_output_arguments, require_outputs, write_outputs
from stcalib_ros.core.errors import InputError
from stcalib_ros.io.convert import Converted, ConvertOptions, convert_arrays, convert_npz
from stcalib_ros.io.datasets import DATASETS, DatasetOptions, read_dataset

MAX_SEED = 2**63
"""Largest seed of random numbers, as of a simulated scene."""

MAX_NOISE_PX = 1e4
"""Pixels. Noise that is larger leaves nothing of a pose, as of a simulated scene."""

DESCRIPTION = """\
Make a bag, and its true values, from a multi-view .npz file with detected poses, or from a data set
in its official layout.

  stcalib convert balance.npz balance.mcap --truth balance_truth.yaml --offset cam02=0.317
  stcalib convert 160906_pizza1 pizza.mcap --format panoptic --cameras 2,12,21,28 --truth t.yaml
  stcalib convert labels/64pm/lobby_3 lobby.mcap --format mmptrack --fps 15 --poses alphapose

Data sets (--format)
  panoptic     the folder of a sequence: calibration_*.json, hdPose3d_stage1_coco19/
  easymocap    the folder of a scene (ZJU-MoCap): intri.yml, extri.yml, annots/, keypoints3d/
  mmptrack     the folder of a scene's labels, with ../../../calibrations beside it
The poses are those in --poses (POSES/CAMERA/alphapose-results.json of AlphaPose with tracking and
POSES/CAMERA/IDX/X3D.npy of MotionBERT; without the latter, 2D only), or the true joints with noise
(--sigma-px).

An .npz file has the arrays
  camera_names, image_size, K, dist, R, t    x_cam = R x_world + t
  fps, frame_number
  det_frame, det_camera, det_track           detections: indices, and the camera's own track id
  det_person                                 who it truly is; -1: unknown
  det_kp2d, kp_names                         x, y, score; 0, 0, 0: not detected
  det_kp3d, kp3d_names                       monocular 3D pose, metres, camera axes; may be missing
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("source", type=Path, metavar="SOURCE", help="file or folder, see above")
    add_output_arguments(parser)
    parser.add_argument(
        "--format",
        choices=["npz", *DATASETS],
        default="npz",
        help="what SOURCE is (default: %(default)s)",
    )
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
    write_outputs(args, *_converted(args))


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


def _converted(args: argparse.Namespace) -> Converted:
    options = ConvertOptions(dict(args.offset), args.fps, args.layout)
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
    if args.format != "npz":
        arrays = read_dataset(args.format, args.source, DatasetOptions(**given))
        return convert_arrays(args.source, arrays, options)
    if given:
        raise InputError("--cameras, --frames, --poses, --sigma-px and --seed need a --format")
    return convert_npz(args.source, options)


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
