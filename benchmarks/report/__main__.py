"""The report of a large recording: megabytes, CPU seconds, and seconds until a browser shows it.

    python -m benchmarks.report            12 cameras, 3,000 images each, 4 people
    python -m benchmarks.report --keep big.html

Opening is measured where Chromium is installed, without a graphics card. Exit status 1 if a target
is missed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.report.browser import CHROMIUM, Browser
from benchmarks.table import Row, print_rows
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.mocap import shipped_clips
from stcalib_ros.report.content import content_of_result
from stcalib_ros.report.html import report_html

_MOST_MB = 10.0
"""Megabytes of the file, at most: what an e-mail takes."""
_LONGEST_S = 3.0
"""Seconds until the page is loaded and drawn, at most."""
_WIDTHS = (1400, 390)
_TIMES = 3
"""Openings; the shortest counts, so that other programs on the machine matter less."""


def main(argv: Sequence[str] | None = None) -> int:
    """Make the report, measure it and print the table.

    Returns
    -------
    int
        Exit status: 1 if a target is missed.
    """
    parser = argparse.ArgumentParser(prog="python -m benchmarks.report")
    parser.add_argument("--cameras", type=int, default=12)
    parser.add_argument("--images", type=int, default=3000)
    parser.add_argument("--people", type=int, default=4)
    parser.add_argument("--keep", type=Path, metavar="OUT.html", help="keep the report")
    args = parser.parse_args(argv)
    options = SceneOptions(
        n_cameras=args.cameras, n_people=args.people, n_frames=args.images, seed=1
    )
    scene = simulate(options, clips=shipped_clips())
    begin = time.process_time()
    html = report_html(content_of_result(scene.recording, scene.truth))
    cost_s = time.process_time() - begin
    size_mb = len(html.encode()) / 1e6
    rows = [
        Row("size", f"{size_mb:.2f} MB", f"<= {_MOST_MB:g} MB", size_mb <= _MOST_MB),
        Row("made in", f"{cost_s:.1f} s CPU", "", None),
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = args.keep or Path(folder) / "report.html"
        path.write_text(html, encoding="utf-8")
        rows += _opened(path)
    title = f"report of {args.cameras} cameras, {args.images} images each, {args.people} people"
    print_rows(title, rows, file=sys.stdout)
    return int(any(row.met is False for row in rows))


def _opened(path: Path) -> list[Row]:
    if CHROMIUM is None:
        return [Row("opens in", "Chromium is not installed", "", None)]
    rows = []
    for width in _WIDTHS:
        browser = Browser()
        phone = width == min(_WIDTHS)
        seconds = min(browser.open(path, width, mobile=phone) for _ in range(_TIMES))
        rows.append(
            Row(
                f"at {width} px",
                f"opens in {seconds:.2f} s, {len(browser.problems)} problems",
                f"<= {_LONGEST_S:g} s",
                seconds <= _LONGEST_S and not browser.problems,
            )
        )
        browser.close()
    return rows


if __name__ == "__main__":
    sys.exit(main())
