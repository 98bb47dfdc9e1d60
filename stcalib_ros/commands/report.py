"""``stcalib report``: the report of a finished result, and its figures."""

from __future__ import annotations

import argparse
from pathlib import Path

from stcalib_ros.commands.result_and_bag import add_result_and_bag_arguments, read_bag_as_configured

# What computes is imported by the functions that need it, for `--help` to be quick.

DESCRIPTION = """\
Write the report of a result: one HTML file with a verdict, the room in 3D, clocks, people and
residuals. It opens in any browser, also on a phone, and needs no internet.

  stcalib report walk.yaml walk.mcap --output walk.html

BAG is the bag that was calibrated, or a later one of the same cameras and clocks: what it shows is
compared with the result. A refused result (walk.rejected.yaml) has a report, too.

`stcalib calibrate walk.mcap --output walk.yaml --report walk.html` does both in one command.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_result_and_bag_arguments(parser, ".mcap file or rosbag2 folder")
    parser.add_argument(
        *("-o", "--output"),
        type=Path,
        metavar="OUT.html",
        help="file to write (default: RESULT.html)",
    )
    parser.add_argument(
        "--figures",
        type=Path,
        metavar="DIR",
        help="also write the pictures for talks and papers there, as PNG and SVG",
    )


def run(args: argparse.Namespace) -> None:
    """Gather the evidence, and write the report.

    Raises
    ------
    InputError
        An argument or file is unusable, or the bag and the result have no two cameras in common
        that see anybody.
    """
    from stcalib_ros.commands.terminal import tell, warn
    from stcalib_ros.io.results import read_result
    from stcalib_ros.report import require_matplotlib
    from stcalib_ros.report.content import content_of_result
    from stcalib_ros.report.fits import camera_fits
    from stcalib_ros.report.grade import disagreeing
    from stcalib_ros.report.html import write_report

    output = args.output or args.result.with_suffix(".html")
    require_report(output)
    if args.figures is not None:
        require_matplotlib("--figures")
    calibration = read_result(args.result)
    recording, config = read_bag_as_configured(args)
    content = content_of_result(recording, calibration, config.options)
    write_report(content, output)
    if off := disagreeing(camera_fits(content.evidence, [c.name for c in calibration.cameras])):
        warn(f"{args.bag} does not agree with {args.result} in {', '.join(off)}: see the report")
    written = [output]
    if args.figures is not None:
        from stcalib_ros.report.figures import write_figures

        written += write_figures(content, args.figures)
    paths = [str(path) for path in written]
    tell(args, f"Written to {', '.join(paths)}", {"written": paths})


def require_report(path: Path) -> None:
    """Make sure, before the long work, that a report can be made and written.

    Raises
    ------
    InputError
        It cannot.
    """
    from stcalib_ros.io.files import require_writable
    from stcalib_ros.report.three_js import require_three_js

    require_writable(path)
    require_three_js()
