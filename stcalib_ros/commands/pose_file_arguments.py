"""Arguments for poses in the files of other programs; imports nothing that takes long."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

from stcalib_ros.core.errors import InputError

ESTIMATOR_OPTIONS = ("image_size", "videos", "stamps")
"""Those that are of use only where a pose estimator wrote the files."""

POSE_FILE_OPTIONS = (*ESTIMATOR_OPTIONS, "format", "fps", "layout", "cameras", "frames")
"""All of them."""


def add_pose_file_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what can be said of such files."""
    group = parser.add_argument_group("poses in the files of other programs")
    group.add_argument(
        "--format", metavar="NAME", help="format of SOURCE (default: by its content)"
    )
    group.add_argument(
        "--fps", type=float, metavar="HZ", help="frame rate (default: that of SOURCE)"
    )
    group.add_argument(
        "--image-size",
        type=_image_size,
        metavar="WxH",
        help="size of the images in pixels, if SOURCE does not say",
    )
    group.add_argument(
        "--layout",
        metavar="NAME",
        help="layout of the joints (default: by their names or number)",
    )
    group.add_argument(
        "--videos",
        type=Path,
        metavar="DIR",
        help="folder with the videos, CAMERA.mp4, to read frame rate and size from",
    )
    group.add_argument(
        "--stamps",
        type=Path,
        metavar="FILE.csv",
        help="time of each image: columns camera, frame, stamp; or a folder of CAMERA.csv",
    )
    group.add_argument(
        "--cameras", metavar="A,B,...", help="cameras to use, in this order (default: all)"
    )
    group.add_argument(
        "--frames",
        type=_frame_range,
        metavar="FIRST:LAST",
        help="range of images to use, as SOURCE numbers them",
    )


def refuse_options(args: argparse.Namespace, options: Iterable[str], why: str) -> None:
    """Refuse options that are given, but of no use.

    Parameters
    ----------
    args : Namespace
    options : iterable of str
        Names of the attributes.
    why : str
        Ends the message, after the name of the option.

    Raises
    ------
    InputError
        One of them is given.
    """
    if given := [option for option in options if getattr(args, option) is not None]:
        raise InputError(f"--{given[0].replace('_', '-')} {why}")


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
