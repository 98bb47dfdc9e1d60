"""One movement by every camera's own clock, and by the common one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from stcalib_ros.report.curves import Curve, Movement


def draw_movement(
    before: Axes, after: Axes, movement: Movement, colors: Mapping[str, str], *, unit: str
) -> None:
    """Draw the same heights against raw stamps (before) and corrected ones (after).

    The lines of `after` carry the camera's names and offsets as labels for a legend.
    """
    start = min(float(np.nanmin(c.stamps_s)) for c in movement.curves)
    for curve in movement.curves:
        color, label = colors[curve.camera], f"{curve.camera}  {_offset(curve, movement)}"
        for ax, times in ((before, curve.stamps_s), (after, curve.times_s)):
            ax.plot(times - start, curve.height, color=color, linewidth=1.6, label=label)
    before.set_title("Before: by each camera's own clock")
    after.set_title("After: by the common clock")
    before.tick_params(labelbottom=False)
    after.set_xlabel("time [s]")
    for ax in (before, after):
        ax.set_ylabel(f"height [{unit}]")
        ax.margins(x=0.02)


def _offset(curve: Curve, movement: Movement) -> str:
    if curve.camera == movement.reference:
        return "reference"
    return f"{1e3 * float(np.nanmedian(curve.times_s - curve.stamps_s)):+.0f} ms"
