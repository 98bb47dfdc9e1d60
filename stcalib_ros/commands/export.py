"""``stcalib export``: a result in the formats of other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.exports import EXPORTS, Exported, exported_files, write_files
from stcalib_ros.io.files import require_writable
from stcalib_ros.io.results import read_usable_result

_FORMATS = "\n".join(
    f"  {form.name:12s} {form.summary} [{', '.join(form.endings) or 'folder'}]"
    for form in EXPORTS.values()
)

DESCRIPTION = f"""\
Write a result in the format of another program.

  stcalib export walk.yaml --format kalibr --output camchain.yaml
  stcalib export walk.yaml --format colmap --output sparse

Formats (--format), with what the name of the file ends in
{_FORMATS}

Lengths are those of the result: metres, or the distance between its first two cameras.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("result", type=Path, metavar="RESULT.yaml", help="result file to export")
    parser.add_argument(*("-f", "--format"), required=True, choices=list(EXPORTS), help="see above")
    parser.add_argument(
        *("-o", "--output"), type=Path, required=True, metavar="OUT", help="file or folder to write"
    )


def run(args: argparse.Namespace) -> None:
    """Export.

    Raises
    ------
    InputError
        A file is unusable, or the format cannot hold the calibration.
    """
    calibration = read_usable_result(args.result)
    form = EXPORTS[args.format]
    try:
        files = exported_files(Exported(calibration), form, args.output)
    except InputError as error:
        raise InputError(f"{args.result}: {error}") from error
    if not form.endings:
        _make_folder(args.output)
    for path in files:
        require_writable(path)
    write_files(files)
    unit = "metres" if calibration.metric else "the distance between the first two cameras is 1"
    print(f"Written to {args.output}: {len(calibration.cameras)} cameras ({unit})")


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot write to the folder {path}: {error.strerror or error}; name another"
        ) from error
