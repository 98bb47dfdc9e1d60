"""Tables in CSV files, and times in them."""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.files import read_bounded
from stcalib_ros.io.limits import MAX_CSV_BYTES, MAX_TIME_S
from stcalib_ros.io.messages import NS
from stcalib_ros.io.sources.cameras import plain_name, with_suffix
from stcalib_ros.io.sources.form import CameraPoses, PoseSource, reading, whole_number

CAMERA = ("camera", "cam", "cam_id", "camera_id", "camera_name", "port")
FRAME = ("frame", "frame_index", "frame_number", "image", "index")
TIME = ("stamp", "time", "timestamp", "frame_time", "seconds")
"""What columns are called, in small letters."""
_UNITS = {"_ns": 1, "_us": 10**3, "_ms": 10**6, "_s": NS}
"""Nanoseconds by how the name of a column of times ends. By definition."""
_SEPARATORS = ",;\t"
"""What is between columns; spreadsheets write semicolons where decimals have a comma."""
_DECIMAL_COMMA = re.compile(r"^(\s*[-+]?\d+),(\d+)")
_UNIX = ((10**17, 1), (10**14, 10**3), (10**11, 10**6))
"""Unix times of this century from which on they are in ns, us and ms, and their ns. Derived: 10^11
s are 3000 years, 10^14 us as ms would be as many."""


def read_table(path: Path) -> dict[str, list[str]]:
    """Columns of a CSV file by their names in small letters.

    Raises
    ------
    InputError
        It cannot be read, has no rows, or rows of several lengths.
    """
    lines = [line for line in read_bounded(path, MAX_CSV_BYTES).splitlines() if line.strip()]
    separator = _separator("".join(lines[:1]))
    try:
        header, *rows = csv.reader(lines, delimiter=separator)
    except (csv.Error, ValueError):
        raise InputError(f"{path} is no table of comma-separated values with a header") from None
    names = [name.strip().lower() for name in header]
    if wrong := [k for k, row in enumerate(rows) if len(row) != len(names)]:
        raise InputError(
            f"{path}: row {wrong[0] + 2} has {len(rows[wrong[0]])} values, the header {len(names)}"
        )
    if not rows:
        raise InputError(f"{path} has a header, but no rows")
    if separator != ",":
        rows = [[_DECIMAL_COMMA.sub(r"\1.\2", value) for value in row] for row in rows]
    return {name: [row[k] for row in rows] for k, name in enumerate(names)}


def _separator(header: str) -> str:
    return max(_SEPARATORS, key=header.count)


def column_names(header: str) -> list[str]:
    """Names of the columns, in small letters, by the first line of a table."""
    return [name.strip().strip('"').lower() for name in header.split(_separator(header))]


def find_column(columns: Collection[str], names: Sequence[str]) -> str | None:
    """Return the column that has one of some names, where times may have a unit behind it."""
    units = ("", *_UNITS) if names is TIME else ("",)
    wanted = [name + unit for name in names for unit in units]
    return next((name for name in wanted if name in columns), None)


def stamps_of(column: str, values: Sequence[str]) -> list[int]:
    """Times in ns, to the last digit; a ValueError if one is no time.

    The unit is that in the name of the column; else Unix times are taken for seconds, ms, us or ns
    by their size.
    """
    try:
        times = [Decimal(value) for value in values]
    except InvalidOperation:
        raise ValueError(f"{column} has a value that is no number") from None
    if not all(time.is_finite() for time in times):
        raise ValueError(f"{column} has a value that is not finite")
    largest = max((abs(time) for time in times), default=Decimal(0))
    by_size = next((unit for least, unit in _UNIX if largest >= least), NS)
    unit = next((ns for ending, ns in _UNITS.items() if column.endswith(ending)), by_size)
    if largest * unit > MAX_TIME_S * NS:
        raise ValueError(f"{column} has {largest:.6g}, more than a stamp can hold")
    return [int((time * unit).to_integral_value()) for time in times]


def with_stamps(source: PoseSource, path: Path) -> PoseSource:
    """Return a source whose images have the times of a table.

    Parameters
    ----------
    source : PoseSource
    path : Path
        CSV file with the columns camera, frame and stamp; or a folder with a file for each camera,
        named like it. Without a column of frames, rows are images 0, 1, ...

    Raises
    ------
    InputError
        A camera or an image that has poses is not in it.
    """
    files = with_suffix(sorted(path.iterdir()), ".csv") if path.is_dir() else [path]
    stamps: dict[str, dict[int, int]] = {}
    for file in files:
        with reading(file, "a table of the times of images"):
            for name, of_camera in _times(file, named_by_file=path.is_dir()).items():
                stamps.setdefault(name, {}).update(of_camera)
    cameras = tuple(_with_stamps(camera, stamps, path) for camera in source.cameras)
    return replace(source, cameras=cameras)


def _times(file: Path, *, named_by_file: bool) -> dict[str, dict[int, int]]:
    """Times by camera and image."""
    table = read_table(file)
    camera, frame, time = (find_column(table, names) for names in (CAMERA, FRAME, TIME))
    if time is None or (camera is None and not named_by_file):
        raise InputError(
            f"{file} has the columns {', '.join(table)[:200]}: expected camera, frame and stamp"
        )
    times = stamps_of(time, table[time])
    names = (
        [plain_name(name) for name in table[camera]]
        if camera
        else [plain_name(file.stem)] * len(times)
    )
    found: dict[str, dict[int, int]] = {}
    for row, (name, stamp) in enumerate(zip(names, times, strict=True)):
        of_camera = found.setdefault(name, {})
        number = whole_number(table[frame][row]) if frame else len(of_camera)
        if number in of_camera:
            raise InputError(f"{file}: image {number} of {name} has two times")
        of_camera[number] = stamp
    return found


def _with_stamps(
    camera: CameraPoses, stamps: Mapping[str, Mapping[int, int]], path: Path
) -> CameraPoses:
    if camera.name not in stamps:
        raise InputError(f"{path} has no times of {camera.name}, but of {', '.join(stamps)}")
    of_camera = stamps[camera.name]
    if missing := sorted({pose.image for pose in camera.poses} - of_camera.keys()):
        raise InputError(f"{path} has no time of image {missing[0]} of {camera.name}")
    images = sorted(of_camera)
    return replace(
        camera,
        images=np.array(images, dtype=np.int64),
        stamps_ns=np.array([of_camera[image] for image in images], dtype=np.int64),
    )
