"""Charts: round ticks, gaps, names that are anybody's text."""

from __future__ import annotations

import re

import numpy as np
import pytest

from stcalib_ros.report.charts import Axis, Line, Mark, axis_of, chart


@pytest.mark.parametrize(
    ("low", "high", "ticks"),
    [
        (0.0, 10.0, [0.0, 2.5, 5.0, 7.5, 10.0]),
        (-0.3, 1.7, [0.0, 0.5, 1.0, 1.5]),
        (-1600.0, 1600.0, [-1000.0, 0.0, 1000.0]),
        (0.001, 0.0021, [0.001, 0.0015, 0.002]),
    ],
)
def test_ticks_are_round_and_within(low: float, high: float, ticks: list[float]) -> None:
    assert Axis(low, high, "x").ticks() == pytest.approx(ticks)


def test_an_axis_has_room_for_all_values() -> None:
    axis = axis_of([np.array([1.0, np.nan, 3.0]), np.array([])], "x")
    assert axis.low < 1.0
    assert 3.0 < axis.high < 3.2
    wide = axis_of([np.array([2.0])], "x", least=4.0)
    assert (wide.low, wide.high) == pytest.approx((-0.16, 4.16))
    assert axis_of([], "x").ticks()


def drawn(line: Line) -> str:
    html = chart("a", [line], Axis(0.0, 1.0, "x"), Axis(0.0, 1.0, "y"))
    return re.findall(r'class="(?:line|dots|area|band)"[^>]* d="([^"]*)"', html)[0]


def test_a_gap_is_a_gap() -> None:
    x = np.linspace(0.0, 1.0, 5)
    y = np.array([0.0, 1.0, np.nan, 0.5, 0.5])
    assert drawn(Line(x, y, "#000")) == "M0.0 1000.0L250.0 0.0M750.0 500.0L1000.0 500.0"
    assert drawn(Line(x, y, "#000", dots=True)).count("h0") == 4
    assert drawn(Line(x[:2], y[:2], "#000", filled=True)).endswith("L250.0 1000L0.0 1000Z")


def test_long_lines_have_no_more_points_than_a_screen() -> None:
    x = np.linspace(0.0, 1.0, 100_000)
    assert drawn(Line(x, x, "#000")).count("L") < 1000


def test_texts_are_anybodys() -> None:
    mark = Mark(0.9, "<b>", "#111")
    axes = Axis(0.0, 1.0, "<i>"), Axis(0.0, 1.0, "<u>")
    html = chart("<script>", [], *axes, marks=[mark], names=[("<s>", "#222")])
    assert not re.search(r"<(script|b|i|u|s)>", html.replace('<b style="color:#222">', ""))
    assert 'class="named before"' in html


def test_zero_has_no_sign() -> None:
    html = chart("a", [], Axis(-1.0, 1.0, "x"), Axis(-1.0, 1.0, "y"))
    assert ">0.0<" in html
    assert "-0.0<" not in html


def test_a_band_goes_there_and_back() -> None:
    x, y, to = np.array([0.0, 0.5, 1.0]), np.array([0.1, np.nan, 0.2]), np.array([0.5, 0.6, 0.7])
    path = drawn(Line(x, y, "#000", to=to))
    assert path == "M0.0 900.0L1000.0 800.0L1000.0 300.0L0.0 500.0Z"


def test_large_counts_have_four_digits_at_most() -> None:
    axis = Axis(0.0, 1.0, "x")
    html = chart("a", [], axis, axis, counts=[(0.25, 9999), (0.5, 12_345)])
    assert 'left:25.00%">9999<' in html
    assert 'left:50.00%">12k<' in html
