"""What the commands print: progress, and results in plain words."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TextIO

import numpy as np

from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration
from stcalib_ros.core.model.rejection_text import whole_sentences
from stcalib_ros.core.model.rolling_shutter import line_time_text

_BAR = 24


def warn(message: str) -> None:
    """Print a warning."""
    print(f"stcalib: warning: {message}", file=sys.stderr)


class ProgressPrinter:
    """Shows progress: one line that changes on a terminal, else a line for every stage.

    Parameters
    ----------
    stream : file object or None
        Usually standard error; None: nothing is shown.
    """

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = stream
        self._live = stream is not None and stream.isatty()
        self._shown = ""

    def __call__(self, stage: str, fraction: float) -> None:
        """Take note that `fraction` of `stage` is done."""
        if self._live:
            done = round(_BAR * min(max(fraction, 0.0), 1.0))
            bar = "#" * done + "." * (_BAR - done)
            self._replace(f"[{bar}] {stage}")
        elif self._stream is not None and stage != self._shown:
            self._shown = stage
            print(stage, file=self._stream, flush=True)

    def warn(self, message: str) -> None:
        """Print a warning without disturbing the line."""
        self.close()
        warn(message)

    def close(self) -> None:
        """Take the line away."""
        if self._live and self._shown:
            self._replace("")

    def _replace(self, line: str) -> None:
        if self._stream is not None and line != self._shown:
            self._stream.write(f"\r\x1b[K{line}")
            self._stream.flush()
            self._shown = line


def table(rows: Sequence[Sequence[str]]) -> str:
    """Columns of text, aligned to the left; the first row is the head."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
    return "\n".join(lines)


def calibration_text(calibration: Calibration) -> str:
    """Say for a person what was found.

    Raises
    ------
    ValueError
        There are no cameras in it.
    """
    if not calibration.cameras:
        raise ValueError("a calibration without cameras has nothing to tell")
    n, n_all = len(calibration.cameras), len(calibration.cameras) + len(calibration.uncalibrated)
    head = (
        f"{n} of {n_all} cameras calibrated on {_count(len(calibration.persons), 'person')}, "
        f"{calibration.n_inliers} of {calibration.n_observations} image points, "
        f"reprojection error {calibration.reprojection_rms_px:.2f} px (rms)."
    )
    parts = [head, _cameras(calibration), _directions(calibration)]
    if remarks := whole_sentences(calibration.remarks, calibration.rejections):
        parts.append("\n".join(remarks))
    if calibration.persons:
        parts.append(_persons(calibration))
    parts += [f"NOT calibrated: {c.name}: {c.reason}" for c in calibration.uncalibrated]
    return "\n\n".join(parts)


def _count(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def _directions(calibration: Calibration) -> str:
    ref = calibration.reference
    frame = f"the optical frame of {ref} (x right, y down, z forward)"
    if calibration.frame_id:
        frame = f"{calibration.frame_id} (z up, floor at 0, below {ref}, which looks along x)"
    return (
        f"Poses are T_ref_cam: where a camera is and looks in {frame}, in {_unit(calibration)}.\n"
        f"Add a camera's offset to its stamps to have the clock of {ref}: "
        "t_ref = t_cam + offset. +- is one standard deviation."
    )


def _unit(calibration: Calibration) -> str:
    if not calibration.metric:
        return "distances between the first two cameras"
    if not np.isfinite(calibration.scale_stddev):
        return "metres"
    return f"metres (good to {100 * calibration.scale_stddev:.2g} %)"


def _cameras(calibration: Calibration) -> str:
    unit = "m" if calibration.metric else "baselines"
    head = ("camera", f"position x y z [{unit}]", "looks along x y z", "turned", "clock offset")
    return table([head, *(_camera_row(c, calibration.reference) for c in calibration.cameras)])


def _camera_row(camera: CameraCalibration, reference: str) -> tuple[str, ...]:
    position = _triple(camera.t_ref_cam, 3)
    looks_along = _triple(camera.R_ref_cam[:, 2], 2)
    turned = f"{float(np.degrees(rotation_angle(camera.R_ref_cam))):.1f} deg"
    variances = np.maximum(np.diag(camera.covariance), 0.0)
    if variances.any() or camera.name != reference:
        position += _plus_minus(np.sqrt(variances[:3].sum()), 3)
        turned += _plus_minus(np.degrees(np.sqrt(variances[3:].sum())), 2)
    if camera.name == reference:
        clock = "reference" + line_time_text(camera)
        return (camera.name, position, looks_along, turned, clock)
    offset = f"{camera.time_offset_s * 1e3:+.2f} ms"
    offset += _plus_minus(camera.time_offset_stddev_s * 1e3, 2)
    if camera.clock_skew:
        offset += f", {camera.clock_skew * 1e6:+.2f} ppm"
        offset += _plus_minus(camera.clock_skew_stddev * 1e6, 2)
    return (
        camera.name,
        position,
        looks_along,
        turned,
        offset + line_time_text(camera),
    )


def _plus_minus(stddev: float, digits: int) -> str:
    return f" +- {stddev:.{digits}f}" if np.isfinite(stddev) else ""


def _triple(values: Float64Array, digits: int) -> str:
    return " ".join(f"{v + 0.0:{digits + 4}.{digits}f}" for v in np.round(values, digits))


def _persons(calibration: Calibration) -> str:
    rows = [("person", "tracks", "reprojection", "next best assignment")]
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
                f"{person.margin:.1f} x worse" if np.isfinite(person.margin) else "-",
            )
        )
    return table(rows)
