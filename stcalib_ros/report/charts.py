"""Line charts whose text stays as large as the page's, however narrow the screen is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array

_WIDTH, _HEIGHT = 1000.0, 1000.0
"""Units of the drawing, which is stretched to the place that there is."""
_TICKS = 4
"""Intervals of an axis, about: as many labels as fit on a phone."""
_MOST_POINTS = 800
"""Points of a line: as many as a screen has columns."""
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
_HAIR = 1e-9
_MANY = 10_000
"""Count from which on thousands are written, for four digits at most."""
_MIDDLE = 0.5
"""Fraction of the width, right of which a name stands to the left of its line."""


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A line of a chart, or dots.

    Attributes
    ----------
    x, y : (N,) ndarray
        NaN: a gap.
    color : str
    dots : bool
        Dots instead of a line.
    filled : bool
        Filled down to the axis.
    to : (N,) ndarray, optional
        A band from `y` to these values, instead of a line.
    """

    x: Float64Array
    y: Float64Array
    color: str
    dots: bool = False
    filled: bool = False
    to: Float64Array | None = None


@dataclass(frozen=True, slots=True)
class Mark:
    """A named vertical line of a chart."""

    x: float
    text: str
    color: str


@dataclass(frozen=True, slots=True)
class Axis:
    """Range and name of an axis; the unit is in the name."""

    low: float
    high: float
    name: str

    def ticks(self) -> list[float]:
        """Return round values within the range."""
        span = max(self.high - self.low, _HAIR)
        power = 10.0 ** math.floor(math.log10(span / _TICKS))
        step = next(s * power for s in _STEPS if s * power * _TICKS >= span * (1.0 - _HAIR))
        first = math.ceil(self.low / step - _HAIR)
        return [k * step for k in range(first, math.floor(self.high / step + _HAIR) + 1)]

    def place(self, values: Float64Array | float) -> Float64Array:
        """Return where values are on the axis, 0..1 within its range."""
        span = max(self.high - self.low, _HAIR)
        return np.asarray((np.asarray(values, float) - self.low) / span)


def axis_of(values: Sequence[Float64Array], name: str, *, least: float = 0.0) -> Axis:
    """Return an axis for some values, with a margin, and `least` wide at least."""
    known = np.concatenate([np.zeros(0), *(v[np.isfinite(v)] for v in values)])
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    missing = max(least - (high - low), 0.0) / 2.0
    margin = 0.04 * max(high - low, least)
    return Axis(low - missing - margin, high + missing + margin, name)


def chart(
    title: str,
    lines: Sequence[Line],
    x: Axis,
    y: Axis,
    *,
    marks: Sequence[Mark] = (),
    names: Sequence[tuple[str, str]] = (),
    counts: Sequence[tuple[float, int]] = (),
) -> str:
    """Return a chart as markup; all texts are plain.

    Parameters
    ----------
    title : str
    lines : sequence of Line
    x, y : Axis
    marks : sequence of Mark, optional
    names : sequence of (str, str), optional
        Names of lines, with their colours.
    counts : sequence of (float, int), optional
        Numbers along the x axis, with their places.
    """
    paths = [_tick_lines(x, y), *(_path(line, x, y) for line in lines)]
    paths += [_upright(mark, x) for mark in marks]
    labels = [_label("x", tick, float(x.place(tick)), x.ticks()) for tick in x.ticks()]
    labels += [_label("y", tick, 1.0 - float(y.place(tick)), y.ticks()) for tick in y.ticks()]
    labels += [_mark_label(mark, x, k) for k, mark in enumerate(marks)]
    labels += [_count_label(n, float(x.place(place))) for place, n in counts]
    legend = " ".join(f'<b style="color:{color}">{escape(name)}</b>' for name, color in names)
    return (
        f'<figure class="chart"><figcaption>{escape(title)}</figcaption>\n'
        + (f'<p class="axis names">{legend}</p>' if legend else "")
        + f'<p class="axis">{escape(y.name)}</p><div class="plot">'
        f'<svg viewBox="0 0 {_WIDTH:.0f} {_HEIGHT:.0f}" preserveAspectRatio="none" role="img" '
        f'aria-label="{escape(title)}">{"".join(paths)}</svg>{"".join(labels)}</div>\n'
        f'<p class="axis across">{escape(x.name)}</p></figure>'
    )


def _tick_lines(x: Axis, y: Axis) -> str:
    across = [f"M0 {_HEIGHT * (1.0 - float(y.place(t))):.1f}H{_WIDTH:.0f}" for t in y.ticks()]
    up = [f"M{_WIDTH * float(x.place(t)):.1f} 0V{_HEIGHT:.0f}" for t in x.ticks()]
    return f'<path class="grid" d="{"".join([*across, *up])}"/>'


def _path(line: Line, x: Axis, y: Axis) -> str:
    every = slice(None, None, 1 + len(line.x) // _MOST_POINTS)
    px, py = _WIDTH * x.place(line.x[every]), _HEIGHT * (1.0 - y.place(line.y[every]))
    known = np.isfinite(px) & np.isfinite(py)
    if line.dots:
        d = "".join(f"M{a:.1f} {b:.1f}h0" for a, b in zip(px[known], py[known], strict=True))
        return f'<path class="dots" style="stroke:{line.color}" d="{d}"/>'
    if line.to is not None:
        return _band(line, px[known], py[known], _HEIGHT * (1.0 - y.place(line.to[every][known])))
    begin = known & ~np.concatenate([[False], known[:-1]])
    d = "".join(
        f"{'M' if new else 'L'}{a:.1f} {b:.1f}"
        for a, b, new in zip(px[known], py[known], begin[known], strict=True)
    )
    if line.filled and known.any():
        base = f"L{px[known][-1]:.1f} {_HEIGHT:.0f}L{px[known][0]:.1f} {_HEIGHT:.0f}Z"
        return f'<path class="area" style="fill:{line.color}" d="{d}{base}"/>'
    return f'<path class="line" style="stroke:{line.color}" d="{d}"/>'


def _band(line: Line, px: Float64Array, py: Float64Array, to: Float64Array) -> str:
    there = [f"{a:.1f} {b:.1f}" for a, b in zip(px, py, strict=True)]
    back = [f"{a:.1f} {b:.1f}" for a, b in zip(px[::-1], to[::-1], strict=True)]
    d = f"M{'L'.join([*there, *back])}Z" if there else ""
    return f'<path class="band" style="fill:{line.color}" d="{d}"/>'


def _upright(mark: Mark, x: Axis) -> str:
    place = _WIDTH * float(x.place(mark.x))
    return f'<path class="mark" style="stroke:{mark.color}" d="M{place:.1f} 0V{_HEIGHT:.0f}"/>'


def _label(side: str, value: float, place: float, ticks: Sequence[float]) -> str:
    step = ticks[1] - ticks[0] if len(ticks) > 1 else abs(value) or 1.0
    digits = max(0, -math.floor(math.log10(step) + _HAIR))
    digits += not math.isclose(step * 10**digits, round(step * 10**digits), rel_tol=1e-6)
    text = f"{value + 0.0:.{digits}f}"
    text = text.lstrip("-") if float(text) == 0.0 else text
    where = f"{'left' if side == 'x' else 'top'}:{100.0 * place:.2f}%"
    return f'<span class="tick {side}" style="{where}">{text}</span>'


def _count_label(n: int, place: float) -> str:
    text = str(n) if n < _MANY else f"{n / 1000.0:.0f}k"
    return f'<span class="tick count" style="left:{100.0 * place:.2f}%">{text}</span>'


def _mark_label(mark: Mark, x: Axis, row: int) -> str:
    place = float(x.place(mark.x))
    side = ("before" if place > _MIDDLE else "after") + (" second" if row else "")
    style = f"left:{100.0 * place:.2f}%;color:{mark.color}"
    return f'<span class="named {side}" style="{style}">{escape(mark.text)}</span>'
