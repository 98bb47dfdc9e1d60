"""What ``simulate`` and ``convert`` have in common: a bag to write, and its true values."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.io.bag_writer import require_bag_writable, write_bag
from stcalib_ros.io.files import require_writable
from stcalib_ros.io.results import write_result
from stcalib_ros.wording import count


def add_output_arguments(parser: argparse.ArgumentParser) -> None:
    """Add ``OUT.mcap`` and ``--truth``."""
    parser.add_argument(
        "output",
        type=Path,
        metavar="OUT.mcap",
        help="bag to write; a name without .mcap makes a rosbag2 folder",
    )
    parser.add_argument(
        "--truth", type=Path, metavar="TRUTH.yaml", help="also write the true values"
    )


def require_outputs(args: argparse.Namespace) -> None:
    """Make sure that both can be written.

    Raises
    ------
    InputError
        One cannot.
    """
    require_bag_writable(args.output)
    if args.truth is not None:
        require_writable(args.truth)


def write_outputs(
    args: argparse.Namespace, recording: Recording, truth: Calibration | None
) -> None:
    """Write both."""
    write_bag(recording, args.output)
    if args.truth is not None and truth is not None:
        write_result(truth, args.truth)


def written_text(args: argparse.Namespace, recording: Recording) -> str:
    """Say what was written."""
    images = count(sum(len(camera.stamps) for camera in recording.cameras), "image")
    text = f"Written to {args.output}: {count(len(recording.cameras), 'camera')}, {images}"
    return text if args.truth is None else f"{text}\nTrue values are in {args.truth}"


def written_plain(args: argparse.Namespace, recording: Recording) -> dict[str, Any]:
    """Return the same as plain data."""
    truth = getattr(args, "truth", None)
    return {
        "bag": str(args.output),
        "truth": None if truth is None else str(truth),
        "cameras": [
            {
                "name": camera.name,
                "images": len(camera.stamps),
                "poses": sum(len(track.frames) for track in camera.tracks),
                "layout": camera.layout.name,
                "lens_known": camera.intrinsics.known,
            }
            for camera in recording.cameras
        ],
    }
