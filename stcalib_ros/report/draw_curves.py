"""One movement by every camera's own clock, and by the common one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from stcalib_ros.report.curves import Curve, Movement


def draw_movement(
    before: Axes, after: Axes, movement: Movement, colors: Mapping[str, str], *, unit: str
) -> None:
    """Draw the same heights against raw stamps (before) and corrected ones (after)."""
    start = min(float(np.nanmin(c.stamps_s)) for c in movement.curves)
    for curve in movement.curves:
        color = colors[curve.camera]
        _curve(before, curve.stamps_s - start, curve, color)
        _curve(after, curve.times_s - start, curve, color)
    before.set_title("before: by each camera's own stamps")
    after.set_title("after: by the common clock")
    after.set_xlabel("time [s]")
    for ax in (before, after):
        ax.set_ylabel(f"height [{unit}]")


def _curve(ax: Axes, times: np.ndarray, curve: Curve, color: str) -> None:
    ax.plot(times, curve.height, color=color, linewidth=1.4, label=curve.camera)
