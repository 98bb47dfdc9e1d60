"""The page of results, docs/results.md, from the rows of the experiments."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Sequence
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np
import scipy
from matplotlib.figure import Figure

import stcalib_ros
from benchmarks.paper.experiments import EXPERIMENTS
from benchmarks.paper.run import Row, figures, stored
from benchmarks.paper.tables import tables

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "results.md"
FIGURE = ROOT / "docs" / "images" / "noise.png"

_SECTION = re.compile(r"^<!-- (\w+) -->\n", re.MULTILINE)


def write_report(out: Path) -> None:
    """Write the page and its figure from the stores in a folder; experiments not run are named."""
    notes = read_notes()
    parts = [notes["introduction"], _environment()]
    for name, experiment in EXPERIMENTS.items():
        rows = [row for _, of_task in stored(out / f"{name}.jsonl") for row in of_task]
        command = f"`python -m benchmarks.paper {name}`"
        parts.append(f"## {experiment.title}\n\n{command}\n\n{notes[name]}")
        wanted = len(experiment.tasks())
        done = sum(1 for _ in stored(out / f"{name}.jsonl"))
        if not rows:
            parts.append("Not run yet.\n" if wanted else "Its data is not here.\n")
            continue
        if done < wanted:
            parts.append(f"Incomplete: {done} of {wanted} tasks.\n")
        parts.append(tables(name, rows) + "\n")
        if name == "noise":
            draw_noise(rows, FIGURE)
    parts.append(f"## Peers\n\n`python -m benchmarks.peers`\n\n{notes['peers']}")
    rows = [row for _, of_task in stored(out / "peers.jsonl") for row in of_task]
    parts.append(tables("peers", rows) + "\n" if rows else "Not run yet.\n")
    PAGE.write_text("\n".join(parts), encoding="utf-8")


def read_notes() -> dict[str, str]:
    """Read the notes on each experiment, by its name, and the introduction."""
    text = (Path(__file__).parent / "notes.md").read_text(encoding="utf-8")
    _, *pieces = _SECTION.split(text)
    return {name: body.strip() + "\n" for name, body in zip(pieces[::2], pieces[1::2], strict=True)}


def _environment() -> str:
    return (
        f"stcalib_ros {stcalib_ros.__version__}, Python {platform.python_version()}, "
        f"NumPy {np.__version__}, SciPy {scipy.__version__}, OpenCV {cv2.__version__}; "
        f"{_processor()}, {os.cpu_count()} cores.\n"
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def draw_noise(rows: Sequence[Row], path: Path) -> None:
    """Mean E_R over sigma, windows over the clip and one window alone."""
    mpl.use("Agg")
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    titles = {"windows": "20 windows of 5 frames", "one window": "one window of 5 frames"}
    for axis, (stage, title) in zip(axes, titles.items(), strict=True):
        of_stage = [r for r in rows if r["stage"] == stage]
        for method in dict.fromkeys(r["method"] for r in of_stage):
            mine = [r for r in of_stage if r["method"] == method]
            sigmas = sorted({r["sigma_px"] for r in mine})
            means = [
                np.mean(figures([r for r in mine if r["sigma_px"] == s], "E_R")) for s in sigmas
            ]
            axis.semilogy(sigmas, means, marker="o", label=method)
        axis.set(title=title, xlabel="sigma, px", xticks=[1, 2, 3, 4, 5])
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("mean E_R, rad")
    axes[1].legend(fontsize="small")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, metadata={"Software": None})
