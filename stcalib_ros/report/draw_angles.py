"""Reprojection errors of every camera by the angle from its optical axis."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stcalib_ros.report.angles import ErrorsByAngle
from stcalib_ros.report.grid import camera_axes
from stcalib_ros.report.style import FAINT, PALETTE

_HEIGHT_IN = 2.3
"""Inches. Height of the axes of one camera."""


def angles_figure(cameras: Sequence[ErrorsByAngle]) -> Figure:
    """Draw quartiles of the errors, and of their outward part, all cameras with one scale."""
    figure, axes = camera_axes(
        [one.name for one in cameras],
        height_in=_HEIGHT_IN,
        x_label="angle from the optical axis [deg]",
        y_label="px",
    )
    for i, (ax, one) in enumerate(zip(axes, cameras, strict=True)):
        ax.axhline(0.0, color=FAINT, linewidth=0.8)
        _quartiles(ax, one, PALETTE[i % len(PALETTE)])
    axes[0].legend(fontsize=7, loc="upper right")
    return figure


def _quartiles(ax: Axes, camera: ErrorsByAngle, color: str) -> None:
    for quartiles, shade, name in (
        (camera.error_px, FAINT, "error"),
        (camera.outward_px, color, "outward part"),
    ):
        low, median, high = quartiles.T
        ax.fill_between(camera.angle_deg, low, high, color=shade, alpha=0.2, linewidth=0.0)
        ax.plot(camera.angle_deg, median, color=shade, linewidth=1.6, label=name)
