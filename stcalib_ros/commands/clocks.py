"""``stcalib clocks``: how to cut videos so that they are synchronous."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from stcalib_ros.core.errors import InputError

if TYPE_CHECKING:
    from stcalib_ros.core.capture.cuts import VideoCut

# What computes is imported by the functions that need it, for `--help` to be quick.

DESCRIPTION = """\
Print how to trim the videos of a bag so that they all begin and end at the same time.

  stcalib clocks walk.yaml walk.mcap --videos cam0=left.mp4 cam1=right.mp4

For each video it prints an ffmpeg command, and what trimming cannot remove: the fraction of a frame
by which its images are later than those of the reference camera. The first image of a camera in
the bag is taken as the first frame of its video.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("result", type=Path, metavar="RESULT.yaml", help="result of a calibration")
    parser.add_argument("bag", type=Path, metavar="BAG", help="the bag that was calibrated")
    parser.add_argument(
        "--videos",
        nargs="+",
        type=_video,
        default=[],
        metavar="CAM=FILE",
        help="videos of the cameras (default: CAM.mp4)",
    )
    parser.add_argument(
        *("-c", "--config"), type=Path, metavar="FILE", help="as for `stcalib calibrate`"
    )


def run(args: argparse.Namespace) -> None:
    """Print a table of cuts, and the commands that make them.

    Raises
    ------
    InputError
        An argument or file is unusable.
    CalibrationError
        The result is of a calibration that was refused.
    """
    from stcalib_ros.commands.terminal import tell, warn
    from stcalib_ros.core.capture.cuts import video_cuts
    from stcalib_ros.io.bag import read_bag
    from stcalib_ros.io.config import Config, read_config
    from stcalib_ros.io.results import read_usable_result

    config = Config() if args.config is None else read_config(args.config)
    calibration = read_usable_result(args.result)
    recording = read_bag(args.bag, selection=config.selection, decoder=args.decoder, warn=warn)
    cuts = video_cuts(recording, calibration)
    videos: Mapping[str, Path] = dict(args.videos)
    names = [cut.camera for cut in cuts]
    if unknown := [name for name in videos if name not in names]:
        raise InputError(
            f"--videos {unknown[0]}=...: no such camera in {args.result}; there are "
            f"{', '.join(names)}"
        )
    tell(args, cuts_text(cuts, videos, calibration.reference), [asdict(cut) for cut in cuts])


def cuts_text(cuts: Sequence[VideoCut], videos: Mapping[str, Path], reference: str) -> str:
    """Return a table of cuts and the commands that make them."""
    from stcalib_ros.commands.terminal import table

    head = ("camera", "frames", "from", "Hz", "later, first frame", "later, last frame")
    rows = [
        (
            cut.camera,
            f"{cut.first} to {cut.first + cut.n_images - 1}",
            f"{cut.begin_s:.3f} s",
            f"{cut.rate_hz:.2f}",
            f"{cut.late_frames:+.2f} frames",
            f"{cut.late_at_end_frames:+.2f} frames",
        )
        for cut in cuts
    ]
    like = {cut.camera: cut for cut in cuts}.get(reference, cuts[0])
    commands = [
        _command(cut, videos.get(cut.camera, Path(f"{cut.camera}.mp4")), like) for cut in cuts
    ]
    return "\n".join([table([head, *rows]), "", *commands])


def _command(cut: VideoCut, video: Path, reference: VideoCut) -> str:
    """Return the command that cuts one video, to the rate and number of images of the reference."""
    begin, from_zero = f"trim=start_frame={cut.first}", "setpts=PTS-STARTPTS"
    if cut.other_rate:
        at_rate, end = f"fps={reference.rate_hz:.3f}", f"trim=end_frame={reference.n_images}"
        filters = [begin, from_zero, at_rate, end]
    else:
        filters = [f"{begin}:end_frame={cut.first + cut.n_images}", from_zero]
    output = video.with_name(f"{video.stem}_sync{video.suffix}")
    return shlex.join(["ffmpeg", "-i", str(video), "-vf", ",".join(filters), "-an", str(output)])


def _video(text: str) -> tuple[str, Path]:
    """Camera and the file of its video."""
    name, equals, path = text.partition("=")
    if not (name and equals and path):
        raise argparse.ArgumentTypeError(f"expected CAM=FILE, got {text!r}")
    return name, Path(path)
