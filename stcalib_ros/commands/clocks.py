"""``stcalib clocks``: how to cut videos so that they are synchronous."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from stcalib_ros.commands.result_and_bag import add_result_and_bag_arguments, read_bag_as_configured
from stcalib_ros.core.errors import InputError

if TYPE_CHECKING:
    from stcalib_ros.core.capture.cuts import VideoCut

# What computes is imported by the functions that need it, for `--help` to be quick.

DESCRIPTION = """\
Print how to trim the videos of a bag so that they all begin and end at the same time.

  stcalib clocks walk.yaml walk.mcap --videos cam0=left.mp4 cam1=right.mp4

For each video it prints an ffmpeg command, and what trimming cannot remove: the fraction of a frame
by which its images are later than those of the reference camera. Frames are counted in the videos;
of a video that is not there, the images of the bag are taken as its frames.

The first image of a camera in the bag is taken as the first frame of its video, unless the bag was
made from this video (its stamps tell), or --bag-begins gives the time between both.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_result_and_bag_arguments(parser, "the bag that was calibrated")
    parser.add_argument(
        "--videos",
        nargs="+",
        type=_video,
        default=[],
        metavar="CAM=FILE",
        help="videos of the cameras (default: CAM.mp4)",
    )
    parser.add_argument(
        "--bag-begins",
        nargs="+",
        type=_begin,
        default=[],
        metavar="CAM=S",
        help="seconds after the first frame of its video at which the first image of a camera in "
        "the bag was taken",
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
    from stcalib_ros.core.capture.reprojection import reference_times
    from stcalib_ros.io.bag_origin import read_origin
    from stcalib_ros.io.results import read_usable_result
    from stcalib_ros.io.video_frames import VideoPlaces, with_frames

    calibration = read_usable_result(args.result)
    recording, _ = read_bag_as_configured(args)
    names = list(reference_times(recording, calibration))
    _require_cameras("--videos", args.videos, names, args.result)
    _require_cameras("--bag-begins", args.bag_begins, names, args.result)
    videos = {name: Path(f"{name}.mp4") for name in names} | dict(args.videos)
    here = {name: path for name, path in videos.items() if path.exists()}
    if absent := [name for name in dict(args.bag_begins) if name not in here]:
        raise InputError(
            f"--bag-begins {absent[0]}=...: no such file: {videos[absent[0]]}; name the video with "
            f"--videos {absent[0]}=FILE"
        )
    places = VideoPlaces(read_origin(args.bag), dict(args.bag_begins), warn)
    cuts = video_cuts(with_frames(recording, here, places), calibration)
    if missing := [str(path) for name, path in videos.items() if name not in here]:
        warn(
            f"not here: {', '.join(missing)}; the images of the bag are taken as the frames of "
            "these videos, which is wrong where the bag has fewer"
        )
    tell(args, cuts_text(cuts, videos, calibration.reference), [asdict(cut) for cut in cuts])


def _require_cameras(
    option: str, given: Sequence[tuple[str, object]], names: Sequence[str], result: Path
) -> None:
    if unknown := [name for name, _ in given if name not in names]:
        raise InputError(
            f"{option} {unknown[0]}=...: no such camera in {result}; there are {', '.join(names)}"
        )


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
    commands = [_command(cut, videos[cut.camera], like) for cut in cuts]
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


def _begin(text: str) -> tuple[str, float]:
    """Camera and seconds."""
    name, _, seconds = text.partition("=")
    if not name or not seconds.replace(".", "", 1).isdecimal():
        raise argparse.ArgumentTypeError(f"expected CAM=S with S in seconds, got {text!r}")
    return name, float(seconds)
