"""``stcalib place``: a result in the frame of a floor plan or map."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from stcalib_ros.core.errors import InputError

if TYPE_CHECKING:
    from stcalib_ros.core.output.floor_plan import PlacedCalibration

# What computes is imported by the functions that need it, for `--help` to be quick.

DESCRIPTION = """\
Put the origin of a result where you want it: say where some of its cameras are on a floor plan or
map.

  stcalib place walk.yaml --at cam0=0.5,4.2 cam2=7.1,0.4 --output hall.yaml
  stcalib place walk.yaml --at cam0=0.5,4.2,2.6 cam1=7,4.2,2.5 cam2=7.1,0.4,2.7 --output hall.yaml

x and y of two cameras are enough if the result has a vertical (world_frame in the configuration);
otherwise x, y and z of three that are not in a line. The place of a camera is that of its lens, in
metres, as on a map: x to the right, y up the page, z towards the ceiling. Of more cameras, all are
used, and it is said how well they agree. If the result has no unit of length, it gets metres.
"""

_MOST_NUMBERS = 3
"""Count of the coordinates of a place, if its height is among them. By definition."""
_FARTHEST_M = 1e4
"""Metres. Places beyond are refused: pictures in 3D have 24 bits, with which 10 km are known to a
millimetre. Chosen: a map of a building or a site has its origin there."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("result", type=Path, metavar="RESULT.yaml", help="result of a calibration")
    parser.add_argument(
        "--at",
        nargs="+",
        type=_place,
        required=True,
        metavar="CAM=X,Y[,Z]",
        help="where a camera is, in metres",
    )
    parser.add_argument(
        *("-o", "--output"),
        type=Path,
        required=True,
        metavar="OUT.yaml",
        help="result file to write",
    )
    parser.add_argument(
        "--frame",
        default="map",
        metavar="NAME",
        help="name of the frame in which these places are (default: map)",
    )


def run(args: argparse.Namespace) -> None:
    """Place a result.

    Raises
    ------
    InputError
        An argument or file is unusable, or the cameras are not so far apart as was said.
    CalibrationError
        The result is of a calibration that was refused.
    """
    import numpy as np

    from stcalib_ros.commands.terminal import tell
    from stcalib_ros.core.options import Options
    from stcalib_ros.core.output.floor_plan import placed_on_plan
    from stcalib_ros.io.files import require_writable
    from stcalib_ros.io.results import read_usable_result, write_result

    require_writable(args.output)
    frame = Options(world_frame=args.frame).world_frame
    if not frame:
        raise InputError("--frame: expected a name")
    names = [name for name, _ in args.at]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"--at: {twice[0]} is given twice")
    places_m = {name: np.array(place) for name, place in args.at}
    try:
        placed = placed_on_plan(read_usable_result(args.result), places_m, frame)
    except InputError as problem:
        raise InputError(f"--at: {problem}") from problem
    write_result(placed.calibration, args.output)
    data = {
        "written": str(args.output),
        "frame": frame,
        "scale": placed.scale,
        "misfits_m": dict(placed.misfits_m),
    }
    tell(args, _text(placed, args.output), data)


def _text(placed: PlacedCalibration, output: Path) -> str:
    from stcalib_ros.commands.terminal import table

    rows: list[tuple[str, ...]] = [("camera", "x", "y", "z", "from where it should be")]
    for camera in placed.calibration.cameras:
        place = [f"{value:+.3f}" for value in camera.t_ref_cam]
        misfit_m = placed.misfits_m.get(camera.name)
        rows.append((camera.name, *place, "" if misfit_m is None else f"{misfit_m:.3f} m"))
    text = f"{table(rows)}\nWritten to {output}: poses in the frame {placed.calibration.frame_id}"
    if placed.scale != 1:
        text += f"; lengths were multiplied by {placed.scale:.4f}"
    return text


def _place(text: str) -> tuple[str, tuple[float, ...]]:
    """Name of a camera, and where it is, metres."""
    name, _, numbers = text.rpartition("=")
    try:
        place = tuple(float(number) for number in numbers.split(","))
    except ValueError:
        place = ()
    if (
        not name
        or len(place) not in (_MOST_NUMBERS - 1, _MOST_NUMBERS)
        or not all(map(_is_plausible, place))
    ):
        raise argparse.ArgumentTypeError(
            f"expected CAM=X,Y or CAM=X,Y,Z, as cam0=0.5,4.2, within 10 km of the origin, in "
            f"metres, got {text!r}"
        )
    return name, place


def _is_plausible(metres: float) -> bool:
    return abs(metres) <= _FARTHEST_M
