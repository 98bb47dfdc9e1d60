"""What ``simulate`` and ``convert`` have in common: a bag to write, and its true values."""

from __future__ import annotations

import argparse
from pathlib import Path

from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.io.bag_writer import require_bag_writable, write_bag
from stcalib_ros.io.files import require_writable
from stcalib_ros.io.results import write_result


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
    """Write both, and say so."""
    write_bag(recording, args.output)
    images = sum(len(camera.stamps) for camera in recording.cameras)
    print(f"Written to {args.output}: {len(recording.cameras)} cameras, {images} images")
    if args.truth is not None and truth is not None:
        write_result(truth, args.truth)
        print(f"True values are in {args.truth}")
