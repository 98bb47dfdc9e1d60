"""What the commands print: progress, warnings and results."""

from __future__ import annotations

import argparse
import sys
import textwrap
import time
from collections.abc import Callable, Sequence
from typing import Any, TextIO

import numpy as np

from stcalib_ros.core.bundle.covariance import largest_stddev
from stcalib_ros.core.errors import one_line
from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration
from stcalib_ros.core.model.rejection_text import left_out_sentences, whole_sentences
from stcalib_ros.io.json_files import json_text
from stcalib_ros.wording import (
    clock_text,
    count,
    decimals,
    frame_text,
    length_unit,
    lens_rows,
    margin_text,
    plus_minus,
    scale_text,
)

_MAX_WARNING = 5000
"""Characters. A warning is cut here, and what cannot be printed is not: data may have anything."""

WIDTH = 100
"""Columns of a terminal. Longer lines of text are broken there. Chosen: the widest table has 98."""

_DEVIATIONS = """\
+- is one standard deviation in the least certain direction, from the scatter of the keypoints. \
What all keypoints have in common, as when a pose estimator places hips too high, is not in it."""

_BAR = 24
"""Characters. Width of the progress bar."""

_SOON_S = 2.0
"""Seconds. A stage that has taken less says nothing of the time that is left. Chosen."""

_LITTLE = 0.05
"""Fraction of a stage that has to be done before the time left can be estimated. Chosen."""


def warn(message: str) -> None:
    """Print a warning."""
    print(f"stcalib: warning: {one_line(message, _MAX_WARNING)}", file=sys.stderr)


def tell(args: argparse.Namespace, text: str, data: Any) -> None:
    """Print what a command found or did: as text, with ``--json`` as one object, with ``-q`` not.

    Parameters
    ----------
    args : argparse.Namespace
        With those of `stcalib_ros.commands.parser.add_printing_arguments`.
    text : str
    data : mapping or list
        The same as plain data.
    """
    if args.json:
        print(json_text(data))
    elif not args.quiet:
        print(text)


class ProgressPrinter:
    """Shows progress: one line that changes on a terminal, else a line for every stage.

    Parameters
    ----------
    stream : file object or None
        Usually standard error; None: nothing is shown.
    verbose : bool
        A line for every stage that is done, with its duration, on a terminal, too.
    clock : callable
        Seconds that only grow.
    """

    def __init__(
        self,
        stream: TextIO | None,
        *,
        verbose: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._stream, self._verbose, self._clock = stream, verbose, clock
        self._live = stream is not None and stream.isatty()
        self._shown, self._stage, self._began = "", "", 0.0

    def __call__(self, stage: str, fraction: float, detail: str = "") -> None:
        """Show that `fraction` of `stage` is done; on a terminal with details, or the time left."""
        if stage != self._stage:
            self._end_stage()
            self._stage, self._began = stage, self._clock()
            if self._stream is not None and not (self._live or self._verbose):
                print(stage, file=self._stream, flush=True)
        if self._live:
            done = round(_BAR * min(max(fraction, 0.0), 1.0))
            bar = "#" * done + "." * (_BAR - done)
            self._replace(f"[{bar}] {stage}{detail or self._time_left(fraction)}")

    def warn(self, message: str) -> None:
        """Print a warning without disturbing the line."""
        self._clear()
        warn(message)

    def close(self) -> None:
        """End the last stage, and clear the line."""
        self._end_stage()
        self._clear()

    def _end_stage(self) -> None:
        """Say how long the stage took, if that is wanted."""
        if self._verbose and self._stage and self._stream is not None:
            self._clear()
            took = self._clock() - self._began
            print(f"{took:6.1f} s  {self._stage}", file=self._stream, flush=True)
        self._stage = ""

    def _time_left(self, fraction: float) -> str:
        """Seconds that the stage still takes if it goes on like this, once that can be said."""
        elapsed = self._clock() - self._began
        if elapsed < _SOON_S or not _LITTLE < fraction < 1.0:
            return ""
        return f", about {seconds_text(elapsed * (1.0 - fraction) / fraction)} left"

    def _clear(self) -> None:
        if self._live and self._shown:
            self._replace("")

    def _replace(self, line: str) -> None:
        if self._stream is not None and line != self._shown:
            self._stream.write(f"\r\x1b[K{line}")
            self._stream.flush()
            self._shown = line


def seconds_text(seconds: float) -> str:
    """Say a duration as people do.

    Examples
    --------
    >>> seconds_text(8.4), seconds_text(200.0)
    ('8 s', '3 min 20 s')
    """
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


class FilmProgressPrinter(ProgressPrinter):
    """Shows how many images of films are done, and the time left.

    Parameters
    ----------
    stream : file object or None
        As of `ProgressPrinter`.
    n_films : int
        Number of films.
    """

    def __init__(self, stream: TextIO | None, n_films: int, *, verbose: bool = False) -> None:
        super().__init__(stream, verbose=verbose)
        self._n_films = n_films

    def images(self, done: int, total: int, left_s: float) -> None:
        """Show that some images of all are done, and how long the rest takes (NaN: unknown)."""
        detail = f": {done} of {total} images"
        if np.isfinite(left_s):
            detail += f", {seconds_text(left_s)} left"
        self(f"people in {self._n_films} films", done / total, detail)


def filled(text: str) -> str:
    """Return a text in lines that fit into a terminal."""
    return textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False)


def table(rows: Sequence[Sequence[str]]) -> str:
    """Return columns of text, aligned to the left; the first row is the head."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
    return "\n".join(lines)


def calibration_text(calibration: Calibration) -> str:
    """Describe a calibration for a person to read.

    Raises
    ------
    ValueError
        There are no cameras in it.
    """
    if not calibration.cameras:
        raise ValueError("a calibration without cameras has nothing to describe")
    n, n_all = len(calibration.cameras), len(calibration.cameras) + len(calibration.uncalibrated)
    head = (
        f"{n} of {n_all} cameras calibrated from {count(len(calibration.persons), 'person')}.\n"
        f"{calibration.n_inliers} of {calibration.n_observations} keypoints fit, with a "
        f"reprojection error of {calibration.reprojection_rms_px:.2f} px (rms)."
    )
    parts = [head, _cameras(calibration), _directions(calibration)]
    if lenses := lens_rows(calibration):
        parts.append(table(lenses))
    if remarks := whole_sentences(calibration.remarks, calibration.rejections):
        parts.append("\n".join(map(filled, remarks)))
    if calibration.persons:
        parts.append(_persons(calibration))
    left_out = [(camera.name, camera.rejection) for camera in calibration.uncalibrated]
    parts += [filled(f"NOT calibrated: {text}") for text in left_out_sentences(left_out)]
    return "\n\n".join(parts)


def _directions(calibration: Calibration) -> str:
    poses = (
        f"Poses are T_ref_cam: where a camera is and looks in {frame_text(calibration)}, "
        f"in {scale_text(calibration)}."
    )
    clocks = (
        f"Add a camera's offset to its timestamps to have the clock of {calibration.reference}: "
        "t_ref = t_cam + offset."
    )
    return "\n".join(map(filled, (poses, clocks, _DEVIATIONS)))


def _cameras(calibration: Calibration) -> str:
    unit = length_unit(calibration.metric)
    head = ("camera", f"position x y z [{unit}]", "looks along x y z", "turned", "clock offset")
    return table([head, *(_camera_row(c, calibration.reference) for c in calibration.cameras)])


def _camera_row(camera: CameraCalibration, reference: str) -> tuple[str, ...]:
    position = _triple(camera.t_ref_cam, 3, 7)
    looks_along = _triple(camera.R_ref_cam[:, 2], 2, 5)
    turned = f"{float(np.degrees(rotation_angle(camera.R_ref_cam))):.1f} deg"
    if camera.covariance.any() or camera.name != reference:
        position += plus_minus(largest_stddev(camera.covariance[:3, :3]), 3)
        turned += plus_minus(float(np.degrees(largest_stddev(camera.covariance[3:, 3:]))), 2)
    return (camera.name, position, looks_along, turned, clock_text(camera, reference))


def _triple(values: Float64Array, digits: int, width: int) -> str:
    return " ".join(text.rjust(width) for text in decimals(values, digits))


def _persons(calibration: Calibration) -> str:
    rows = [("person", "track ids in each camera", "error (rms)", "if taken for another")]
    for person in calibration.persons:
        tracks = "  ".join(
            f"{name}: {' '.join(map(str, ids))}" for name, ids in person.tracks.items()
        )
        rms = person.reprojection_rms_px
        rows.append(
            (
                str(person.person_id),
                tracks,
                f"{rms:.2f} px" if np.isfinite(rms) else "-",
                margin_text(person.margin),
            )
        )
    return table(rows)
