"""One movement by every camera's own clock, and by the common one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from stcalib_ros.report.curves import Curve, Movement

_LEGEND_ROWS = 6


def draw_movement(
    before: Axes, after: Axes, movement: Movement, colors: Mapping[str, str], *, unit: str
) -> None:
    """Draw the same heights against raw stamps (before) and corrected ones (after)."""
    start = min(float(np.nanmin(c.stamps_s)) for c in movement.curves)
    for curve in movement.curves:
        style: dict[str, Any] = {"color": colors[curve.camera], "linewidth": 1.6, "alpha": 0.9}
        label = f"{curve.camera}  {_offset(curve, movement.reference)}"
        before.plot(curve.stamps_s - start, curve.height, **style)
        after.plot(curve.times_s - start, curve.height, label=label, **style)
    before.set_title("Before: by each camera's own clock")
    after.set_title("After: by the common clock")
    before.tick_params(labelbottom=False)
    after.set_xlabel("time [s]")
    for ax in (before, after):
        ax.set_ylabel(f"height [{unit}]")
        ax.margins(x=0.02)
    n_columns = -(-len(movement.curves) // _LEGEND_ROWS)
    after.legend(title="clock offset found", fontsize=8, title_fontsize=8, ncols=n_columns)


def _offset(curve: Curve, reference: str) -> str:
    if curve.camera == reference:
        return "reference"
    return f"{1e3 * float(np.nanmedian(curve.times_s - curve.stamps_s)):+.0f} ms"
