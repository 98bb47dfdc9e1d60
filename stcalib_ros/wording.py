"""How a result is put into words, for the terminal and for reports alike."""

from __future__ import annotations

import math

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration
from stcalib_ros.core.model.lens_knowledge import LensKnowledge, LensStddev
from stcalib_ros.core.model.rolling_shutter import MAX_READOUT_STDDEV_S

PLUS_MINUS = "+-"
_LONG_OFFSET_S = 100.0
"""Seconds. Offsets from here on are said in seconds: of clocks of two epochs. Chosen."""

_BEFORE = {LensKnowledge.REFINE: "a guess", LensKnowledge.UNKNOWN: "unknown"}


def count(n: int, noun: str) -> str:
    """Say how many.

    Examples
    --------
    >>> count(1, "camera"), count(2, "camera"), count(2, "person")
    ('1 camera', '2 cameras', '2 people')
    """
    if n == 1:
        return f"1 {noun}"
    return f"{n} people" if noun == "person" else f"{n} {noun}s"


def plus_minus(stddev: float, digits: int, sign: str = PLUS_MINUS) -> str:
    """Say a standard deviation, after its value; nothing if it is not known.

    Examples
    --------
    >>> plus_minus(0.0126, 3)
    ' +- 0.013'
    """
    return f" {sign} {stddev:.{digits}f}" if math.isfinite(stddev) else ""


def decimals(values: Float64Array, digits: int) -> list[str]:
    """Return numbers with so many decimals; no -0."""
    return [f"{value + 0.0:.{digits}f}" for value in np.round(values, digits)]


def length_unit(metric: bool) -> str:
    """Return the symbol of the unit of length of a calibration."""
    return "m" if metric else "baselines"


def scale_text(calibration: Calibration) -> str:
    """Say the unit of length and how well it is known."""
    if not calibration.metric:
        return "distances between the first two cameras"
    if not math.isfinite(calibration.scale_stddev):
        return "metres"
    return f"metres (good to {100 * calibration.scale_stddev:.2g} %)"


def frame_text(calibration: Calibration) -> str:
    """Say which frame the poses are in."""
    ref = calibration.reference
    if not calibration.frame_id:
        return f"the optical frame of {ref} (x right, y down, z forward)"
    return f"{calibration.frame_id} (z up, floor at 0, below {ref}, which looks along x)"


def clock_text(camera: CameraCalibration, reference: str, sign: str = PLUS_MINUS) -> str:
    """Say time offset, clock skew and line delay of a camera."""
    if camera.name == reference:
        return "reference" + line_delay_text(camera, sign)
    if abs(camera.time_offset_s) < _LONG_OFFSET_S:
        text = f"{1e3 * camera.time_offset_s:+.2f} ms"
        text += plus_minus(1e3 * camera.time_offset_stddev_s, 2, sign)
    else:
        text = f"{camera.time_offset_s:+.5f} s{plus_minus(camera.time_offset_stddev_s, 5, sign)}"
    if camera.clock_skew:
        text += f", {1e6 * camera.clock_skew:+.2f} ppm"
        text += plus_minus(1e6 * camera.clock_skew_stddev, 2, sign)
    return text + line_delay_text(camera, sign)


def line_delay_text(camera: CameraCalibration, sign: str = PLUS_MINUS) -> str:
    """Say the line delay of a camera, after a comma; nothing for a global shutter."""
    line_us, stddev_us = 1e6 * camera.line_time_s, 1e6 * camera.line_time_stddev_s
    if not math.isfinite(stddev_us):
        return f", {line_us:.2f} us per row" if line_us else ""
    if camera.line_time_stddev_s * camera.intrinsics.height <= MAX_READOUT_STDDEV_S:
        return f", {line_us:.2f} {sign} {stddev_us:.2f} us per row"
    return f", {line_us:.2f} us per row (not observable: {sign} {stddev_us:.1f})"


def lens_rows(calibration: Calibration, sign: str = PLUS_MINUS) -> list[tuple[str, ...]]:
    """Say what was found of the lenses that were not given: a head, and a row each; or nothing."""
    cameras = [c for c in calibration.cameras if c.lens_knowledge is not LensKnowledge.GIVEN]
    head = ("lens of", "focal length [px]", "principal point [px]", "model", "radial", "it was")
    return [head, *(_lens_row(camera, sign) for camera in cameras)] if cameras else []


def _lens_row(camera: CameraCalibration, sign: str) -> tuple[str, ...]:
    lens, stddev = camera.intrinsics, camera.lens_stddev or LensStddev(0.0, 0.0, 0.0)
    (fx, _, cx), (_, _, cy) = lens.K[:2]
    point = f"{cx:.1f}{_estimated(stddev.cx_px, 1, sign)}, {cy:.1f}"
    radial = [
        f"k{k} {value:.4f}{_estimated(spread, 4, sign)}"
        for k, (value, spread) in enumerate(zip(lens.D[:2], stddev.radial, strict=False), start=1)
    ]
    return (
        camera.name,
        f"{fx:.1f}{_estimated(stddev.focal_px, 1, sign)}",
        f"{point}{_estimated(stddev.cy_px, 1, sign)}",
        lens.model.value,
        ", ".join(radial) or "-",
        _BEFORE[camera.lens_knowledge],
    )


def _estimated(stddev: float, digits: int, sign: str) -> str:
    return plus_minus(stddev, digits, sign) if stddev > 0 else ""


def margin_text(margin: float) -> str:
    """Say how much worse the next best assignment of a person fits."""
    return f"{margin:.1f} x worse" if math.isfinite(margin) else "none"
