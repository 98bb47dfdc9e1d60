"""Figures of scenes whose lenses were to be found, beside the same with their true lenses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.accuracy.consistency import LENS_BLOCKS, POSE_BLOCKS
from benchmarks.accuracy.lenses import LensRun, LensScenario
from benchmarks.accuracy.measure import Run
from benchmarks.accuracy.summary import (
    Section,
    distribution,
    errors_of,
    median_cpu,
    notes_of,
    single,
)
from benchmarks.table import Row
from stcalib_ros.core.model.lens_knowledge import LensKnowledge

MAX_POSE_RATIO = 2.0
"""Largest accepted ratio of the median E_R and E_t to those with given lenses. From the project's
requirements."""
MAX_OFFSET_RATIO = 1.2
"""The same of E_delta, which lenses are not to change: what medians of 30 scenes scatter by."""
MAX_CPU_RATIO = 1.5
"""The same of CPU seconds. From the project's requirements."""
MAX_REFINED_RATIO = 1.1
"""Largest accepted ratio of E_R and E_t of a real recording to those with the lenses that its
refinement starts from: nothing may get worse than its truth can tell. Chosen."""
NEES = (0.7, 1.5)
"""Range of the mean normalized errors squared. From the project's requirements."""

_RATIOS = {"E_R": MAX_POSE_RATIO, "E_t": MAX_POSE_RATIO, "E_delta": MAX_OFFSET_RATIO}

_OF_RAYS = {"E_R": "E_R_rays", "E_t": "E_t_rays"}
"""Errors of poses, and what is left of them where principal points that are off count as rotations:
within what is known of these, a rotation by the same angle cannot be told from them."""


def lens_section(kind: LensScenario, runs: Sequence[LensRun], poses: str) -> Section:
    """Summarize the scenes of a kind beside their targets."""
    estimated, given = [one.estimated for one in runs], [one.given for one in runs]
    rows = [*_solved(kind, estimated, given)]
    for name in ("E_f", "E_k1"):
        limits = {"median": kind.scenario.medians.get(name)}
        rows.append(distribution(name, errors_of(estimated, name), limits))
        rows.append(_above_floor(name, runs))
    for name, limit in _RATIOS.items():
        rows += _beside(name, estimated, given, limit if kind.has_targets else None)
        rows += [_above_floor(name, runs)] if name in _OF_RAYS else []
    for name in _OF_RAYS.values():
        rows += _beside(name, estimated, given, None)
    for kind_of, blocks in (("poses", POSE_BLOCKS), ("lenses", LENS_BLOCKS)):
        values = [row for one in runs for row in getattr(one, kind_of)]
        rows += _consistency(blocks, values, asked=kind.has_targets)
    rows.append(distribution("CPU s", [run.cpu_s for run in estimated], {}))
    ratio = median_cpu(estimated) / median_cpu(given)
    rows.append(single("CPU / given", ratio, MAX_CPU_RATIO if kind.has_targets else None))
    scenario = kind.scenario
    return Section(
        scenario.name, scenario.title, tuple(rows), notes_of(estimated), tuple(estimated), poses
    )


def _solved(kind: LensScenario, estimated: Sequence[Run], given: Sequence[Run]) -> list[Row]:
    n, wrong = len(estimated), sum(run.wrong for run in estimated)
    solved, usual = (sum(not run.failure for run in runs) for runs in (estimated, given))
    target, met = (f">= {n}", solved >= n) if kind.has_targets else ("", None)
    return [
        Row("solved", f"{solved} of {n}, with given lenses {usual}", target, met),
        Row("wrong, but OK", f"{wrong}", "0", wrong == 0),
    ]


def _beside(
    name: str, estimated: Sequence[Run], given: Sequence[Run], limit: float | None
) -> list[Row]:
    ours, usual = (errors_of(runs, name) for runs in (estimated, given))
    ratio = _ratio(float(np.median(ours)), float(np.median(usual)))
    return [distribution(name, ours, {}), single(f"{name} / given", ratio, limit)]


def _above_floor(name: str, runs: Sequence[LensRun]) -> Row:
    """Return the median of an error at the Cramer-Rao bound, and how far the error is above it."""
    floor = float(np.median([getattr(one.floor, name) for one in runs]))
    ours = float(np.median(errors_of([one.estimated for one in runs], name)))
    return Row(f"{name} at the floor", f"median {floor:.3g}  {_ratio(ours, floor):.2f}x", "", None)


def _ratio(ours: float, usual: float) -> float:
    """Return a ratio; NaN where there is nothing to compare with."""
    return ours / usual if 0.0 < usual < np.inf else float("nan")


def _consistency(
    blocks: Sequence[str], values: Sequence[Sequence[float]], *, asked: bool
) -> list[Row]:
    """Return mean normalized errors squared, without unknowns that were never estimated."""
    low, high = NEES
    rows = []
    for block, column in zip(blocks, np.reshape(values, (-1, len(blocks))).T, strict=True):
        known = column[np.isfinite(column)]
        if len(known):
            mean = float(known.mean())
            text = f"mean {mean:.2f}  p90 {np.percentile(known, 90):.2f}"
            target, met = (
                (f"mean {low:g} to {high:g}", low <= mean <= high) if asked else ("", None)
            )
            rows.append(Row(f"NEES {block}", text, target, met))
    return rows


def beside_given(run: Run, given: Run, knowledge: LensKnowledge) -> list[Row]:
    """Return the ratios of a recording's errors and CPU seconds to those with given lenses."""
    worst = MAX_REFINED_RATIO if knowledge is LensKnowledge.REFINE else None
    rows = []
    for name, limit in {"E_R": worst, "E_t": worst, "E_delta": None}.items():
        (ours,), (usual,) = (errors_of([one], name) for one in (run, given))
        rows.append(single(f"{name} / given", _ratio(ours, usual), limit))
    return [*rows, single("CPU / given", run.cpu_s / given.cpu_s, MAX_CPU_RATIO)]
