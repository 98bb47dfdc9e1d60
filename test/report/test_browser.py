"""The page as people see it: in a browser, on a desk and on a phone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.report.browser import CHROMIUM, Browser
from stcalib_ros.report.content import ReportContent
from stcalib_ros.report.html import write_report

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")

WIDTHS = (1400, 390)


@pytest.fixture(scope="module")
def report(report_content: ReportContent, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("browser") / "report.html"
    write_report(report_content, path)
    return path


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    one = Browser()
    yield one
    one.close()


@pytest.fixture(scope="module", params=WIDTHS)
def opened(request: pytest.FixtureRequest, browser: Browser, report: Path) -> Browser:
    """The page at one width, its 3D view in the middle of the screen."""
    browser.open(report, request.param, mobile=request.param < 500)
    browser.value("document.getElementById('scene').scrollIntoView({block: 'center'})")
    browser.settle()
    return browser


def differing(one: np.ndarray, other: np.ndarray) -> int:
    """How many pixels of two pictures differ."""
    return int((np.abs(one - other).max(-1) > 0.1).sum())


def middle(browser: Browser) -> tuple[float, float]:
    box = browser.box("#scene canvas")
    return box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0


def test_nothing_is_reported_on_the_console(opened: Browser) -> None:
    assert opened.problems == []


def test_nothing_is_wider_than_the_screen(opened: Browser) -> None:
    opened.value("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    wide = opened.value(
        "[...document.querySelectorAll('body *')].filter(e => !e.closest('#scene, svg') &&"
        " e.getBoundingClientRect().right > innerWidth + 1).map(e => e.outerHTML.slice(0, 100))"
    )
    opened.value("document.querySelectorAll('details').forEach(one => { one.open = false; })")
    opened.value("document.getElementById('scene').scrollIntoView({block: 'center'})")
    assert wide == []
    assert opened.value("document.documentElement.scrollWidth <= innerWidth")


def test_text_is_large_enough_to_read(opened: Browser) -> None:
    least = opened.value(
        "Math.min(...[...document.querySelectorAll('p, td, li, figcaption, .tick')]"
        ".filter(e => e.offsetWidth).map(e => parseFloat(getComputedStyle(e).fontSize)))"
    )
    assert least >= 11.5


def test_the_room_is_drawn(opened: Browser) -> None:
    picture = opened.picture("#scene canvas")
    for color in ((0, 114, 178), (213, 94, 0), (0, 158, 115)):  # of the three cameras
        near = np.abs(picture - np.array(color) / 255.0).max(-1) < 0.25
        assert near.sum() > 50, color
    names = opened.value("[...document.querySelectorAll('#scene span')].map(e => e.textContent)")
    assert names == ["cam0", "cam1", "cam2", "person 0", "person 1"]


def test_the_slider_moves_the_people(opened: Browser) -> None:
    pictures = []
    for part in (0.2, 0.8):
        opened.value(
            "{ const slider = document.getElementById('time');"
            f" slider.value = slider.max * {part}; slider.dispatchEvent(new Event('input')); }}"
        )
        opened.settle()
        pictures.append(opened.picture("#scene canvas"))
    assert 50 < differing(*pictures) < 0.3 * pictures[0][..., 0].size


def test_it_plays_and_stops(opened: Browser) -> None:
    opened.value("document.getElementById('play').click()")
    begin = opened.value("document.getElementById('clock').textContent")
    opened.settle(6)
    assert opened.value("document.getElementById('clock').textContent") != begin
    opened.value("document.getElementById('play').click()")
    opened.settle()
    stopped = opened.value("document.getElementById('clock').textContent")
    opened.settle(4)
    assert opened.value("document.getElementById('clock').textContent") == stopped


def test_it_turns_stays_upright_and_comes_back(opened: Browser) -> None:
    x, y = middle(opened)
    before = opened.picture("#scene canvas")
    opened.drag((x, y), (x + 90, y + 20))
    opened.settle(30)  # until it has come to rest
    turned = differing(before, opened.picture("#scene canvas"))
    assert turned > 300
    opened.value("document.getElementById('reset').click()")
    opened.settle(30)
    # But for the edges of lines, of which a software renderer colours some anew.
    assert differing(before, opened.picture("#scene canvas")) < 0.05 * turned


def test_two_fingers_zoom(browser: Browser, report: Path) -> None:
    browser.open(report, 390, mobile=True)
    browser.value("document.getElementById('scene').scrollIntoView({block: 'center'})")
    browser.settle()
    before = browser.picture("#scene canvas")
    x, y = middle(browser)
    browser.touch("touchStart", [(x - 20, y), (x + 20, y)])
    for reach in (30, 45, 60, 80):
        browser.touch("touchMove", [(x - reach, y), (x + reach, y)])
    browser.touch("touchEnd", [])
    browser.settle(15)
    assert differing(before, browser.picture("#scene canvas")) > 300
    assert browser.value("visualViewport.scale") == 1.0


def test_a_report_without_poses_has_no_scene(
    browser: Browser, report_content: ReportContent, tmp_path: Path
) -> None:
    bare = replace(report_content.calibration, cameras=(), persons=(), pairs=())
    path = tmp_path / "bare.html"
    write_report(replace(report_content, calibration=bare, evidence=None), path)
    browser.open(path, 390, mobile=True)
    assert browser.problems == []
    assert browser.value("document.documentElement.scrollWidth <= innerWidth")
