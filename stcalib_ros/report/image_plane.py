"""Residuals of a camera over its image, and how large they are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.report.angles import ErrorsByAngle
from stcalib_ros.report.charts import Axis, Line, axis_of, chart
from stcalib_ros.report.fits import KeypointFit

_COLUMNS = 12
"""Cells of the image across; they are about as high as wide."""
_LEAST = 15
"""Keypoints of a cell that is shown: fewer have no usual error."""
_BINS = 40
_ARROW = 0.9
"""Length of the longest arrow in cells."""
_ERROR = "#7D8690"
"""Grey of errors beside the colour of a camera, on light and dark pages."""
_FOR_COUNTS = 0.2
"""Fraction of the height of a chart, below its curves, for the numbers of keypoints."""


def plane(fit: KeypointFit, lens: Intrinsics, limit_px: float) -> str:
    """Return the image of a camera as markup: errors by colour, mean residuals as arrows.

    Parameters
    ----------
    fit : KeypointFit
    lens : Intrinsics
        For the size of the image.
    limit_px : float
        Median error of the darkest cell.
    """
    cell = lens.width / _COLUMNS
    rows = max(1, round(lens.height / cell))
    inside = fit.fits & np.isfinite(fit.pixels).all(-1)
    pixels, residuals, errors = fit.pixels[inside], fit.residuals[inside], fit.errors[inside]
    column = np.floor(pixels[:, 0] / lens.width * _COLUMNS).astype(int)
    row = np.floor(pixels[:, 1] / lens.height * rows).astype(int)
    longest = max(limit_px, 1e-9)
    shapes = []
    for i, j in sorted(set(zip(column.tolist(), row.tolist(), strict=True))):
        here = (column == i) & (row == j)
        if here.sum() < _LEAST or not (0 <= i < _COLUMNS and 0 <= j < rows):
            continue
        share = min(float(np.median(errors[here])) / limit_px, 1.0) if limit_px else 0.0
        shapes.append(_cell(i, j, share) + _arrow(i, j, residuals[here].mean(0) / longest))
    size = f"{lens.width} x {lens.height} px"
    return (
        f'<figure class="plane"><svg viewBox="0 0 {_COLUMNS} {rows}" role="img" '
        f'aria-label="{escape(fit.name)}: residuals over the image">'
        f'<rect class="frame" x="0" y="0" width="{_COLUMNS}" height="{rows}"/>'
        f"{''.join(shapes)}</svg>"
        f"<figcaption>Its image, {size}. Dark: median error of {limit_px:.1f} px and more. "
        f"Arrows: mean residual; a cell is {limit_px / _ARROW:.1f} px long.</figcaption></figure>"
    )


def _cell(i: int, j: int, share: float) -> str:
    return (
        f'<rect class="cell" x="{i}" y="{j}" width="1" height="1" '
        f'style="fill-opacity:{0.08 + 0.82 * share:.2f}"/>'
    )


def _arrow(i: int, j: int, part: Float64Array) -> str:
    length = float(np.linalg.norm(part))
    if not math.isfinite(length):
        return ""
    dx, dy = _ARROW * part / max(length, 1.0)
    x, y = i + 0.5, j + 0.5
    return (
        f'<path class="arrow" d="M{x:.2f} {y:.2f}L{x + dx:.2f} {y + dy:.2f}"/>'
        f'<circle class="tip" cx="{x + dx:.2f}" cy="{y + dy:.2f}" r=".07"/>'
    )


def error_histogram(fit: KeypointFit, color: str, limit_px: float) -> str:
    """Return how many keypoints have which error, those that fit and the others."""
    edges = np.linspace(0.0, limit_px, _BINS + 1)
    good, _ = np.histogram(fit.errors[fit.fits], edges)
    rest, _ = np.histogram(np.minimum(fit.errors[~fit.fits], limit_px), edges)
    x, factor = np.repeat(edges, 2)[1:-1], 100.0 / max(len(fit.fits), 1)
    outer, inner = (np.repeat(n * factor, 2) for n in (good + rest, good))
    top = Axis(0.0, 1.05 * max(float(outer.max(initial=0.0)), 1e-6), "% of the keypoints")
    lines = [Line(x, outer, "#A9B0B7", filled=True), Line(x, inner, color, filled=True)]
    return chart(
        f"{fit.name}: {fit.share:.0%} fit, to {fit.rms_px:.1f} px (rms)",
        lines,
        Axis(0.0, limit_px, "error, px (the last bar: this and more)"),
        top,
    )


def angle_axis(cameras: Sequence[ErrorsByAngle]) -> Axis:
    """Return the axis of errors that all cameras have in common, with room for numbers below."""
    values = [quartiles.ravel() for one in cameras for quartiles in (one.error_px, one.outward_px)]
    axis = axis_of([*values, np.zeros(1)], "px", least=1.0)
    return Axis(axis.low - _FOR_COUNTS * (axis.high - axis.low), axis.high, axis.name)


def angle_chart(camera: ErrorsByAngle, color: str, y: Axis) -> str:
    """Return the quartiles of errors, and of their part away from the optical axis, by angle."""
    lines = []
    for quartiles, shade in ((camera.error_px, _ERROR), (camera.outward_px, color)):
        low, median, high = quartiles.T
        lines.append(Line(camera.angle_deg, low, shade, to=high))
        lines.append(Line(camera.angle_deg, median, shade))
    last = float(camera.angle_deg.max(initial=0.0)) + camera.width_deg / 2.0
    x = Axis(0.0, last, "angle from the optical axis, degrees (numbers: keypoints)")
    zero = Line(np.array([x.low, x.high]), np.zeros(2), "#888")
    counts = zip(camera.angle_deg.tolist(), camera.counts.tolist(), strict=True)
    return chart(
        f"{camera.name}: error by angle",
        [zero, *lines],
        x,
        y,
        names=[("error", _ERROR), ("outward part", color)],
        counts=list(counts),
    )
