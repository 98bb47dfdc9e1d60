"""Draws walks.png: walks that calibrate cameras, and walks that do not, seen from above.

python docs/images/walks.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Wedge

CAMERAS = {"cam0": (-4.0, -2.6, 32.0), "cam1": (4.0, -2.6, 148.0), "cam2": (0.0, 3.6, 270.0)}
"""Position (m) and direction of view (degrees) of each camera."""

COLOURS = ("#0072b2", "#d55e00", "#009e73")
GREY = "#8a94a0"


def main() -> None:
    """Draw the four panels."""
    figure, axes = plt.subplots(2, 2, figsize=(9, 6.6), dpi=110)
    t = np.linspace(0, 1, 200)
    wander = [
        np.c_[2.2 * np.cos(5.2 * t + 1), 1.3 * np.sin(7.9 * t)],
        np.c_[-1.8 + 3.8 * t - 0.8 * np.sin(9 * t), 1.5 * np.cos(6 * t)],
        np.c_[1.7 * np.sin(8 * t + 2), -1.2 + 2.3 * t + 0.5 * np.sin(11 * t)],
    ]
    line = [np.c_[-2.4 + 4.8 * t * k, np.full_like(t, y)] for k, y in ((1, 0.0), (0.7, 0.06))]
    march = [np.c_[-2.3 + 4.6 * t, np.full_like(t, y) + 0.25 * np.sin(5 * t)] for y in (-1, 0, 1)]
    apart = [
        np.c_[-3.3 + 0.9 * np.cos(7 * t), 1.9 + 0.4 * np.sin(9 * t)],
        np.c_[3.3 + 0.8 * np.cos(6 * t), 2.0 + 0.5 * np.sin(8 * t)],
    ]
    draw(axes[0, 0], wander, "good: all over, crossing, out of step", good=True)
    draw(axes[0, 1], line, "bad: everybody on one line")
    draw(axes[1, 0], march, "bad: side by side, in step")
    draw(axes[1, 1], apart, "bad: where no two cameras look")
    figure.tight_layout()
    figure.savefig(Path(__file__).with_name("walks.png"))


def draw(axes: Axes, walks: list[np.ndarray], title: str, *, good: bool = False) -> None:
    """Draw cameras with their views, and one path for each person."""
    for name, (x, y, angle) in CAMERAS.items():
        view = Wedge((x, y), 7.0, angle - 27, angle + 27, color=GREY, alpha=0.12, lw=0)
        axes.add_patch(view)
        axes.plot(x, y, "o", color="#30363d", ms=7)
        axes.annotate(
            name, (x, y), (0, 9 if y > 0 else -17), textcoords="offset points", ha="center"
        )
    for path, colour in zip(walks, COLOURS, strict=False):
        axes.plot(*path.T, color=colour, lw=2)
        axes.annotate(
            "", path[-1], path[-6], arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2}
        )
    axes.set_title(title, color="#1a7f37" if good else "#b42318", fontsize=12, fontweight="bold")
    axes.set(xlim=(-5.2, 5.2), ylim=(-3.7, 4.5), aspect="equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for side in axes.spines.values():
        side.set_color("#d0d7de")


if __name__ == "__main__":
    main()
