"""``stcalib export``: a result in the formats of other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from stcalib_ros.commands.terminal import tell
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory
from stcalib_ros.io.exports import EXPORTS, export_calibration
from stcalib_ros.io.results import read_usable_result

_FORMATS = "\n".join(
    f"  {form.name:12s} {form.summary} [{', '.join(form.endings) or 'folder'}]"
    for form in EXPORTS.values()
)

DESCRIPTION = f"""\
Write a result in the format of another program.

  stcalib export walk.yaml --format kalibr --output camchain.yaml
  stcalib export walk.yaml --format colmap --output sparse --bag walk.mcap

Formats (--format), with the ending of the file's name
{_FORMATS}

With --bag, colmap and gltf also contain the people of a recording. Lengths are those of the result:
metres, or multiples of the distance between its first two cameras.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("result", type=Path, metavar="RESULT.yaml", help="result file to export")
    parser.add_argument(*("-f", "--format"), required=True, choices=list(EXPORTS), help="see above")
    parser.add_argument(
        *("-o", "--output"), type=Path, required=True, metavar="OUT", help="file or folder to write"
    )
    parser.add_argument(
        "--bag",
        type=Path,
        metavar="BAG",
        help="recording of the same cameras, whose people are exported too",
    )
    parser.add_argument(
        *("-c", "--config"), type=Path, metavar="FILE", help="of BAG, as for `stcalib calibrate`"
    )


def run(args: argparse.Namespace) -> None:
    """Export.

    Raises
    ------
    InputError
        A file is unusable, or the format cannot hold the calibration or people.
    CalibrationError
        The result is of a calibration that was refused, or what the bag shows does not agree with
        it.
    """
    calibration = read_usable_result(args.result)
    people = () if args.bag is None else _people(args, calibration)
    export_calibration(calibration, args.output, args.format, people)
    unit = "metres" if calibration.metric else "the distance between the first two cameras is 1"
    what = f"{len(calibration.cameras)} cameras" + (f", {len(people)} people" if people else "")
    tell(
        args,
        f"Written to {args.output}: {what} ({unit})",
        {
            "written": str(args.output),
            "format": args.format,
            "cameras": [camera.name for camera in calibration.cameras],
            "people": len(people),
            "metric": calibration.metric,
        },
    )


def _people(args: argparse.Namespace, calibration: Calibration) -> tuple[PersonTrajectory, ...]:
    from stcalib_ros.commands.people import captured

    if not EXPORTS[args.format].takes_people:
        places = ", ".join(name for name, form in EXPORTS.items() if form.takes_people)
        raise InputError(
            f"--bag: {args.format} has no place for people, these have: {places}; joints as "
            "numbers are written by `stcalib people`"
        )
    _, found = captured(args, calibration)
    return found.people
