"""Axes of every camera beside and below each other, in pictures for talks and papers."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stcalib_ros.report.style import PALETTE

_COLUMNS = 4
_WIDTH_IN = 10.0
"""Inches. Width of the whole picture: with its dots per inch, 1600 px."""


def camera_axes(
    names: Sequence[str], *, height_in: float, x_label: str, y_label: str
) -> tuple[Figure, list[Axes]]:
    """Return a figure with axes of every camera, all with one scale, and these axes.

    Parameters
    ----------
    names : sequence of str
    height_in : float
        Height of the axes of one camera, inches.
    x_label, y_label : str
        Below the lowest axes, and beside the leftmost.
    """
    n_columns = min(_COLUMNS, len(names))
    n_rows = -(-len(names) // n_columns)
    figure = Figure(figsize=(_WIDTH_IN, height_in * n_rows), layout="constrained")
    axes = list(figure.subplots(n_rows, n_columns, sharex=True, sharey=True, squeeze=False).flat)
    for i, ax in enumerate(axes):
        if i >= len(names):
            ax.set_axis_off()
            continue
        ax.set_title(names[i], color=PALETTE[i % len(PALETTE)])
        if i % n_columns == 0:
            ax.set_ylabel(y_label)
        if i + n_columns >= len(names):
            ax.set_xlabel(x_label)
            ax.tick_params(labelbottom=True)
    return figure, axes[: len(names)]
