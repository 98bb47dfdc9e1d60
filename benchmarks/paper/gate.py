"""The reduced set against a committed baseline: accuracy must not get worse beyond its noise.

The baseline holds, for every row of trial 0, the figures and how far chance moves them: their
standard deviation over the other trials of the same experiment.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.paper.run import Row, figures

BASELINE = Path(__file__).parent / "baseline.json"
METHODS = ("default", "2D only", "paper")
"""Gated are rows of methods whose name begins so; the others are there to be compared with."""

GATED = ("E_R", "E_t", "E_delta", "precision")
_LEAST = {"E_R": 2e-4, "E_t": 2e-4, "E_delta": 0.02, "precision": 0.01}
"""Differences below these are none, however steady a figure is."""
_STDDEVS = 2.0
"""Standard deviations over trials by which a figure may be worse than the baseline."""

Averages = Mapping[str, Mapping[str, float]]


def averages(name: str, rows: Iterable[Row]) -> dict[str, dict[str, float]]:
    """Means of the gated figures by experiment, scene, method and stage; and missing cameras."""
    groups: dict[str, list[Row]] = defaultdict(list)
    for r in rows:
        if r["method"].startswith(METHODS):
            groups["; ".join((name, r["scene"], r["method"], r["stage"]))].append(r)
    out = {}
    for key, group in groups.items():
        means = {n: float(np.mean(v)) for n in GATED if (v := figures(group, n))}
        failed = sum(r.get("E_R") is None for r in group)
        out[key] = means | {"missing": float(sum(r.get("missing") or 0 for r in group) + failed)}
    return out


def make_baseline(trials: Sequence[Averages]) -> dict[str, dict[str, dict[str, float]]]:
    """Figures of the first trial, with their standard deviations over all."""
    out = {}
    for key, values in trials[0].items():
        entry = {}
        for figure, value in values.items():
            others = [t[key][figure] for t in trials if figure in t.get(key, {})]
            entry[figure] = {"value": value, "stddev": float(np.std(others))}
        out[key] = entry
    return out


def regressions(found: Averages, baseline: Mapping[str, Any]) -> list[str]:
    """Figures that are worse than the baseline beyond its noise, one line each."""
    lines = []
    for key, entry in baseline.items():
        if key not in found:
            lines.append(f"{key}: no such row any more")
            continue
        for figure, expected in entry.items():
            got = found[key].get(figure)
            if got is None:
                lines.append(f"{key}: no {figure} any more")
            elif _worse(figure, got, expected["value"], expected["stddev"]):
                noise = f"noise {expected['stddev']:.2g}"
                lines.append(f"{key}: {figure} {got:.4g}, was {expected['value']:.4g} ({noise})")
    return lines


def _worse(figure: str, got: float, was: float, stddev: float) -> bool:
    if figure == "missing":
        return got > was
    loss = was - got if figure == "precision" else got - was
    return loss > max(_STDDEVS * stddev, _LEAST[figure])


def read_baseline() -> Mapping[str, Any]:
    """The committed baseline."""
    content: Mapping[str, Any] = json.loads(BASELINE.read_text(encoding="utf-8"))
    return content
