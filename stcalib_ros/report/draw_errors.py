"""Reprojection errors of every camera."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stcalib_ros.report.fits import KeypointFit
from stcalib_ros.report.style import PALETTE

_COLUMNS = 4
_BINS = 40
_OUTLIER = "#C3C9CF"


def errors_figure(cameras: Sequence[KeypointFit]) -> Figure:
    """Draw one histogram per camera, all with one scale."""
    n_columns = min(_COLUMNS, len(cameras))
    n_rows = -(-len(cameras) // n_columns)
    figure = Figure(figsize=(10.0, 1.9 * n_rows), layout="constrained")
    everything = np.concatenate([c.errors[c.fits] for c in cameras])
    limit = 2.0 * float(np.percentile(everything, 99)) if len(everything) else 1.0
    axes = figure.subplots(n_rows, n_columns, sharex=True, sharey=True, squeeze=False)
    for i, ax in enumerate(axes.flat):
        if i >= len(cameras):
            ax.set_axis_off()
            continue
        _histogram(ax, cameras[i], PALETTE[i % len(PALETTE)], limit)
        if i % n_columns == 0:
            ax.set_ylabel("keypoints")
        if i + n_columns >= len(cameras):
            ax.set_xlabel("reprojection error [px]")
            ax.tick_params(labelbottom=True)
    return figure


def _histogram(ax: Axes, camera: KeypointFit, color: str, limit: float) -> None:
    bins = np.linspace(0.0, limit, _BINS)
    values = [camera.errors[camera.fits], np.minimum(camera.errors[~camera.fits], limit)]
    colors = [color, _OUTLIER]
    ax.hist(values, bins=bins.tolist(), stacked=True, histtype="stepfilled", color=colors)
    ax.set_title(camera.name, color=color)
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
