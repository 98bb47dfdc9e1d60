"""Colours and typography of all pictures."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

PALETTE = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#882255",
    "#999933",
    "#332288",
    "#7F5F3F",
)
"""One colour per camera (Okabe and Ito's, then Tol's), distinguishable for the colour-blind."""

PEOPLE = ("#22262B", "#6B4F3A", "#4E6070", "#5E4B66", "#4C5B3C")
"""One muted colour per person."""

PEOPLE_ON_SCREEN = ("#8A7355", "#6C8496", "#9A7396", "#74915A", "#B0705F", "#5F8F8A")
"""The same for a page, which may be light or dark."""

FIGURES = ("#F5C400", "#56C1FF", "#FF7A59", "#7CE577", "#E58CF0", "#FFFFFF")
"""One bright colour per person, for images of cameras."""

BACKGROUND = (34, 30, 27)
"""Blue, green, red, around images of cameras."""

DPI = 160

INK = "#22262B"
FAINT = "#6B737C"
GRID = "#E3E6E9"
FLOOR = "#F4F6F7"
FLOOR_LINES = "#D3D9DE"

SETTINGS: Any = {  # versions of Matplotlib type this differently
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "text.color": INK,
    "text.parse_math": False,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "lines.solid_capstyle": "round",
    "savefig.facecolor": "white",
}


def camera_colors(names: Iterable[str]) -> dict[str, str]:
    """Colours by camera name."""
    return {name: PALETTE[i % len(PALETTE)] for i, name in enumerate(names)}
