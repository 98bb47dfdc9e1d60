"""Rows of an experiment as tables, the printed values of the paper beside ours."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.paper.run import Row, figures

PRINTED: Mapping[str, Any] = json.loads(
    (Path(__file__).parent / "printed.json").read_text(encoding="utf-8")
)
"""The paper's tables; its P is the fraction of points within five pixels with the true poses."""

UNITS = {
    "E_R": "E_R rad",
    "E_t": "E_t",
    "E_2D": "E_2D px",
    "E_delta": "E_delta frames",
    "P_5px": "P_5px",
    "precision": "P assoc.",
}
SUCCESS_RAD = 0.1
"""Rotation error up to which a registration counts as successful, rad."""


def tables(name: str, rows: Sequence[Row]) -> str:
    """Markdown of an experiment."""
    return {
        "table1": _staged,
        "table2": _staged,
        "table3": _extremes,
        "noise": _by_sigma,
        "table4": _staged,
        "protocol": _protocol,
        "timing": _timing,
        "real": _staged,
        "peers": _peers,
    }[name](name, rows)


def _staged(name: str, rows: Sequence[Row]) -> str:
    """Per scene: one line for each method and stage, means over the trials."""
    offsets = name in ("table2", "real")
    columns = ["E_R", "E_t", "E_2D", *(["E_delta"] if offsets else [])]
    if name != "table4":
        columns += ["P_5px", "precision"]
    parts = []
    for scene, of_scene in _grouped(rows, "scene").items():
        body = []
        for (method, stage), group in _grouped(of_scene, "method", "stage").items():
            printed = PRINTED.get(name, {})
            values = _by_column(name, _cell(printed, scene, method, stage))
            body.append(
                [
                    method,
                    stage,
                    *(_pair(values.get(c), _mean(group, c)) for c in columns),
                    _success(group),
                ]
            )
        head = ["method", "stage", *(UNITS[c] for c in columns), "complete"]
        parts.append(f"**{scene}**\n\n{markdown(head, body)}")
    return "\n\n".join(parts)


def _cell(printed: Mapping[str, Any], scene: str, *path: str) -> list[float | None]:
    found: Any = printed.get(scene, printed)
    for key in path:
        found = found.get(key, {}) if isinstance(found, Mapping) else {}
    return found if isinstance(found, list) else []


def _by_column(name: str, values: Sequence[float | None]) -> dict[str, float | None]:
    names = PRINTED.get(name, {}).get("columns", [])
    return dict(zip(names, values, strict=False))


def _success(group: Sequence[Row]) -> str:
    """Trials in which all cameras were calibrated."""
    whole = sum(r.get("E_R") is not None and not r.get("missing") for r in group)
    return f"{whole} of {len(group)}"


def _extremes(name: str, rows: Sequence[Row]) -> str:
    """Table III: minimum, maximum and mean over pairs and trials."""
    columns = ["E_R", "E_t", "E_2D", "E_delta", "P_5px", "precision"]
    reductions: dict[str, Callable[[Sequence[float]], float]] = {
        "min": np.min,
        "max": np.max,
        "mean": np.mean,
    }
    parts = []
    for (scene, windows), of_scene in _grouped(rows, "scene", "stage").items():
        body = []
        for method, group in _grouped(of_scene, "method").items():
            for word, reduce in reductions.items():
                cell = _cell(PRINTED[name], scene, method, word) if windows == "windows" else []
                values = _by_column(name, cell)
                body.append(
                    [
                        method,
                        word,
                        *(_pair(values.get(c), _reduced(group, c, reduce)) for c in columns),
                        _failed(group),
                    ]
                )
        title = "20 windows of 5 frames" if windows == "windows" else "one window of 5 frames"
        head = ["method", "", *(UNITS[c] for c in columns), "nothing found"]
        parts.append(f"**{scene}, {title}**\n\n{markdown(head, body)}")
    return "\n\n".join(parts)


def _by_sigma(_: str, rows: Sequence[Row]) -> str:
    """Noise: mean E_R and association precision of each method at each sigma."""
    parts = []
    for windows, of_windows in _grouped(rows, "stage").items():
        body = []
        sigmas = sorted({r["sigma_px"] for r in of_windows})
        for method, group in _grouped(of_windows, "method").items():
            cells = []
            for sigma in sigmas:
                at = [r for r in group if r["sigma_px"] == sigma]
                cells.append(f"{_number(_mean(at, 'E_R'))} / {_number(_mean(at, 'precision'))}")
            body.append([method, *cells, _failed(group)])
        title = "20 windows of 5 frames" if windows == "windows" else "one window of 5 frames"
        head = ["mean E_R rad / P assoc.", *(f"{sigma:g} px" for sigma in sigmas), "nothing found"]
        parts.append(f"**{title}**\n\n{markdown(head, body)}")
    return "\n\n".join(parts)


def _protocol(_: str, rows: Sequence[Row]) -> str:
    """Means over the scenes, and how often E_R is below 0.1 rad."""
    columns = ["E_R", "E_t", "E_2D", "E_delta", "precision", "P_5px"]
    body = []
    for (windows, method), group in _grouped(rows, "stage", "method").items():
        solved = sum(value < SUCCESS_RAD for value in figures(group, "E_R"))
        cells = [_number(_mean(group, c)) for c in columns]
        body.append([method, windows, *cells, f"{solved} of {len(group)}"])
    head = ["method", "", *(UNITS[c] for c in columns), f"E_R < {SUCCESS_RAD}"]
    return markdown(head, body)


def _timing(name: str, rows: Sequence[Row]) -> str:
    """CPU seconds of a calibration, and its error."""
    body = []
    for (stage, method), group in _grouped(rows, "stage", "method").items():
        printed = PRINTED[name][stage] if method == "paper" else None
        cells = [_pair(printed, _median(group, "cpu_s")), _number(_mean(group, "E_R"))]
        body.append([method, stage, *cells, _number(_mean(group, "E_t"))])
    return markdown(["method", "", "CPU s", "E_R rad", "E_t"], body)


def _peers(_: str, rows: Sequence[Row]) -> str:
    """Per kind of scene: medians over the scenes."""
    parts = []
    for kind, of_kind in _grouped(rows, "scene").items():
        body = []
        for (method, given), group in _grouped(of_kind, "method", "stage").items():
            cells = [_number(_median(group, c)) for c in ("E_R", "E_t", "E_delta")]
            reasons = sorted({str(r["failure"]) for r in group if r.get("failure")})
            ran = f"{sum(not r.get('failure') for r in group)} of {len(group)}"
            body.append([method, given, *cells, "; ".join([ran, *reasons])])
        head = ["system", "given", "E_R rad", "E_t", "E_delta frames", "ran"]
        parts.append(f"**{kind}**\n\n{markdown(head, body)}")
    return "\n\n".join(parts)


def _failed(group: Sequence[Row]) -> str:
    """Number of registrations that failed and are not part of the means."""
    return f"{sum(r.get('E_R') is None for r in group)} of {len(group)}"


def _grouped(rows: Iterable[Row], *keys: str) -> dict[Any, list[Row]]:
    groups: dict[Any, list[Row]] = defaultdict(list)
    for r in rows:
        groups[r[keys[0]] if len(keys) == 1 else tuple(r[k] for k in keys)].append(r)
    return groups


def _mean(rows: Sequence[Row], name: str) -> float | None:
    return _reduced(rows, name, np.mean)


def _median(rows: Sequence[Row], name: str) -> float | None:
    return _reduced(rows, name, np.median)


def _reduced(
    rows: Sequence[Row], name: str, reduce: Callable[[Sequence[float]], float]
) -> float | None:
    values = figures(rows, name)
    return float(reduce(values)) if values else None


def _pair(printed: float | None, measured: float | None) -> str:
    """Format a measured value, with the printed one of the paper in brackets."""
    text = _number(measured)
    return text if printed is None else f"{text} [{printed:g}]"


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    if value and abs(value) < 0.0095:
        return f"{value:.1g}" if abs(value) < 5e-5 else f"{value:.4f}"
    return f"{value:.3f}" if abs(value) < 10 else f"{value:.1f}"


def markdown(head: Sequence[str], body: Sequence[Sequence[str]]) -> str:
    """A table."""
    lines = [head, ["---"] * len(head), *body]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
