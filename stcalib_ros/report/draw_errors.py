"""Reprojection errors of every camera."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stcalib_ros.report.fits import KeypointFit
from stcalib_ros.report.grid import camera_axes
from stcalib_ros.report.style import PALETTE

_HEIGHT_IN = 1.9
"""Inches. Height of the axes of one camera."""
_BINS = 40
_OUTLIER = "#C3C9CF"


def errors_figure(cameras: Sequence[KeypointFit]) -> Figure:
    """Draw one histogram per camera, all with one scale."""
    everything = np.concatenate([c.errors[c.fits] for c in cameras])
    limit = 2.0 * float(np.percentile(everything, 99)) if len(everything) else 1.0
    figure, axes = camera_axes(
        [camera.name for camera in cameras],
        height_in=_HEIGHT_IN,
        x_label="reprojection error [px]",
        y_label="keypoints",
    )
    for i, (ax, camera) in enumerate(zip(axes, cameras, strict=True)):
        _histogram(ax, camera, PALETTE[i % len(PALETTE)], limit)
    return figure


def _histogram(ax: Axes, camera: KeypointFit, color: str, limit: float) -> None:
    bins = np.linspace(0.0, limit, _BINS)
    values = [camera.errors[camera.fits], np.minimum(camera.errors[~camera.fits], limit)]
    colors = [color, _OUTLIER]
    ax.hist(values, bins=bins.tolist(), stacked=True, histtype="stepfilled", color=colors)
    if camera.n_fit:
        ax.text(
            0.98,
            0.95,
            f"median {camera.median_px:.1f} px\n{camera.share:.0%} fit",
            transform=ax.transAxes,
            ha="right",
            va="top",
            fontsize=7,
        )
    ax.grid(axis="x", visible=False)
