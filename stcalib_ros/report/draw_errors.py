"""Reprojection errors of every camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stcalib_ros.core.bundle.residuals import errors_px
from stcalib_ros.core.model.arrays import Float32Array
from stcalib_ros.core.stages import Stages
from stcalib_ros.report.style import PALETTE

_COLUMNS = 4
_BINS = 40
_OUTLIER = "#C3C9CF"


@dataclass(frozen=True, slots=True, eq=False)
class CameraErrors:
    """Reprojection errors of one camera, px, of inliers and outliers."""

    name: str
    inliers: Float32Array
    outliers: Float32Array

    @property
    def inlier_fraction(self) -> float:
        """Inliers as a fraction of all observations."""
        return len(self.inliers) / max(len(self.inliers) + len(self.outliers), 1)


def camera_errors(stages: Stages) -> tuple[CameraErrors, ...]:
    """Errors of the last round, in the order of the calibration."""
    if not stages.calibration.cameras:
        return ()
    last = stages.iterations[-1]
    errors = errors_px(last.observations, last.state)
    known = np.isfinite(errors)
    inside, outside = known & last.state.inlier, known & ~last.state.inlier
    names = [stages.lifted[c].name for c in last.rig.cameras]
    return tuple(
        CameraErrors(camera.name, errors[:, c][inside[:, c]], errors[:, c][outside[:, c]])
        for camera in stages.calibration.cameras
        for c in [names.index(camera.name)]
    )


def errors_figure(cameras: Sequence[CameraErrors]) -> Figure:
    """Draw one histogram per camera, all with one scale."""
    n_columns = min(_COLUMNS, len(cameras))
    n_rows = -(-len(cameras) // n_columns)
    figure = Figure(figsize=(10.0, 1.9 * n_rows), layout="constrained")
    everything = np.concatenate([c.inliers for c in cameras])
    limit = 2.0 * float(np.percentile(everything, 99)) if len(everything) else 1.0
    axes = figure.subplots(n_rows, n_columns, sharex=True, sharey=True, squeeze=False)
    for i, ax in enumerate(axes.flat):
        if i >= len(cameras):
            ax.set_axis_off()
            continue
        _histogram(ax, cameras[i], PALETTE[i % len(PALETTE)], limit)
        if i % n_columns == 0:
            ax.set_ylabel("observations")
        if i + n_columns >= len(cameras):
            ax.set_xlabel("reprojection error [px]")
            ax.tick_params(labelbottom=True)
    return figure


def _histogram(ax: Axes, camera: CameraErrors, color: str, limit: float) -> None:
    bins = np.linspace(0.0, limit, _BINS)
    values = [camera.inliers, np.minimum(camera.outliers, limit)]
    colors = [color, _OUTLIER]
    ax.hist(values, bins=bins.tolist(), stacked=True, histtype="stepfilled", color=colors)
    ax.set_title(camera.name, color=color)
    if len(camera.inliers):
        ax.text(
            0.98,
            0.95,
            f"median {np.median(camera.inliers):.1f} px\n{camera.inlier_fraction:.0%} inliers",
            transform=ax.transAxes,
            ha="right",
            va="top",
            fontsize=7,
        )
    ax.grid(axis="x", visible=False)
