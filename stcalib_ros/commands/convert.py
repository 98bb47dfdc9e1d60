"""``stcalib convert``: from other people's files to a bag."""

from __future__ import annotations

import argparse
from pathlib import Path

from stcalib_ros.commands.bag_and_truth import add_output_arguments, require_outputs, write_outputs
from stcalib_ros.io.convert import ConvertOptions, convert_npz

DESCRIPTION = """\
Make a bag, and its true values, from a multi-view .npz file with detected 2D and 3D poses.

  stcalib convert balance.npz balance.mcap --truth balance_truth.yaml --offset cam02=0.317

The file has the arrays
  camera_names, image_size, K, dist, R, t    x_cam = R x_world + t
  fps, frame_number
  det_frame, det_camera, det_track           detections: indices, and the camera's own track id
  det_person                                 who it truly is; -1: unknown
  det_kp2d, kp_names                         x, y, score; 0, 0, 0: not detected
  det_kp3d, kp3d_names                       monocular 3D pose, metres, camera axes
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("source", type=Path, metavar="SOURCE", help=".npz file, see above")
    add_output_arguments(parser)
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
    recording, truth = convert_npz(
        args.source, ConvertOptions(dict(args.offset), args.fps, args.layout)
    )
    write_outputs(args, recording, truth)


def _camera_offset(text: str) -> tuple[str, float]:
    camera, _, seconds = text.rpartition("=")
    try:
        number = float(seconds)
    except ValueError:
        camera = ""
    if not camera:
        raise argparse.ArgumentTypeError(f"expected CAM=SECONDS, as in cam02=0.317, got {text!r}")
    return camera, number
