"""The accuracy that the project promises, in one table.

    python -m benchmarks.accuracy.level                    all simulated scenes
    python -m benchmarks.accuracy.level --demo             and the demo recording
    python -m benchmarks.accuracy.level --only default --scenes 5
    python -m benchmarks.accuracy.level --hard             200 scenes that must not be wrong

Exit status 1 if a target is missed.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np

import stcalib_ros
from benchmarks.accuracy.measure import Run, judged, run_calibration, run_scene, run_scenes
from benchmarks.accuracy.scenarios import HARD, MAX_CPU_S, MAX_RATIO, SCENARIOS, Scenario
from benchmarks.table import Row, finite, print_rows
from stcalib_ros.core.evaluation.metrics import Evaluation, match_quality
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.results import read_result

_ERRORS = ("E_R", "E_t", "E_delta")
_DEMO_FPS = 60.0
"""Frame rate of the demo recording, Hz."""
_DEMO_LIMITS = {"E_R": 0.07, "centres m": 0.25, "offset frames": 3.0}
"""Largest accepted errors of the demo: rad, m, frames; its truth is good to 0.035-0.05 rad."""


@dataclass(frozen=True, slots=True)
class Section:
    """The figures of one scenario."""

    name: str
    title: str
    rows: tuple[Row, ...]
    notes: tuple[str, ...]
    runs: tuple[Run, ...]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark and print the table.

    Returns
    -------
    int
        0 if all targets are met, else 1.
    """
    args = _arguments(argv)
    sections = []
    for scenario in HARD if args.hard else SCENARIOS:
        if args.only in (None, scenario.name):
            n_scenes = args.scenes or scenario.n_scenes
            task = partial(run_scene, scenario)
            runs = run_scenes(task, n_scenes, title=scenario.name, jobs=args.jobs)
            earlier = next((s.runs for s in sections if s.name == scenario.beside), ())
            sections.append(summary(scenario, runs, earlier))
            _print(sections[-1], as_json=args.json)
    if args.demo or args.only == "demo":
        sections.append(demo())
        _print(sections[-1], as_json=args.json)
    if args.json:
        print(json.dumps(finite([asdict(s) for s in sections]), indent=2))
    return 0 if all(row.met is not False for s in sections for row in s.rows) else 1


def summary(scenario: Scenario, runs: Sequence[Run], clean: Sequence[Run] = ()) -> Section:
    """Summarize the figures of the scenes of a scenario beside their targets.

    Parameters
    ----------
    scenario : Scenario
    runs : sequence of Run
    clean : sequence of Run
        Runs of the easier scenario of the same seeds, if any.
    """
    n = len(runs)
    solved, wrong = sum(not run.failure for run in runs), sum(run.wrong for run in runs)
    needed = n - int((1 - scenario.success) * n)
    good, target = (n - wrong, "or refused") if scenario.may_refuse else (solved, "")
    rows = [
        Row("solved", f"{solved} of {n}", f">= {needed} {target}".rstrip(), good >= needed),
        Row("wrong, but OK", f"{wrong}", "0", wrong == 0),
    ]
    for name in _ERRORS:
        values = _errors(runs, name)
        limits = {"median": scenario.medians.get(name), "p90": scenario.p90.get(name)}
        rows.append(_distribution(name, values, limits))
        if clean and (usual := float(np.median(_errors(clean[:n], name)))) > 0.0:
            ratio = float(np.median(values)) / usual
            rows.append(_single(f"{name} / {scenario.beside}", ratio, MAX_RATIO))
    precision = [r.evaluation.precision if r.evaluation else 0.0 for r in runs]
    rows.append(Row("precision", f"median {np.median(precision):.3f}", "", None))
    rows.append(_distribution("CPU s", [r.cpu_s for r in runs], {"max": MAX_CPU_S}))
    notes = tuple(f"seed {run.seed}: {run.failure}" for run in runs if run.failure)
    return Section(scenario.name, scenario.title, tuple(rows), notes, tuple(runs))


def demo() -> Section:
    """Return the figures of the demo recording."""
    folder = Path(stcalib_ros.__file__).parent / "data" / "demo"
    truth = read_result(folder / "balance_truth.yaml")
    outcome = run_calibration(read_bag(folder / "balance.mcap"))
    run = judged(outcome, truth, name="demo", seed=0, fps=_DEMO_FPS, bounds={})
    rows: tuple[Row, ...] = (Row("solved", "no" if run.failure else "yes", "yes", not run.failure),)
    if run.evaluation is not None and outcome.calibration is not None:
        seen_by_all = [p for p in truth.persons if len(p.tracks) == len(truth.cameras)]
        names = [camera.name for camera in truth.cameras]
        _, _, found = match_quality(outcome.calibration.persons, seen_by_all, names)
        rows += _demo_rows(run, run.evaluation, found)
    notes = (run.failure,) if run.failure else ()
    return Section("demo", "four real cameras, BlazePose, clocks shifted", rows, notes, (run,))


def _demo_rows(run: Run, errors: Evaluation, found: float) -> tuple[Row, ...]:
    offset = max(abs(camera.offset_frames) for camera in errors.cameras)
    return (
        _single("E_R", errors.E_R, _DEMO_LIMITS["E_R"]),
        _single("E_t", errors.E_t, None),
        _single("centres m", errors.centre_max, _DEMO_LIMITS["centres m"]),
        _single("offset frames", offset, _DEMO_LIMITS["offset frames"]),
        Row("precision", f"{errors.precision:.3f}", "1", errors.precision == 1),
        Row("people found", f"{found:.3f} of matches", "1", found == 1),
        _single("CPU s", run.cpu_s, MAX_CPU_S),
    )


def _errors(runs: Sequence[Run], name: str) -> list[float]:
    """Return one error of every scene; infinite where there is no calibration."""
    return [getattr(r.evaluation, name) if r.evaluation else np.inf for r in runs]


def _distribution(name: str, values: Sequence[float], limits: Mapping[str, float | None]) -> Row:
    figures = {
        "median": float(np.median(values)),
        "p90": float(np.percentile(values, 90, method="nearest")),
        "max": float(np.max(values)),
    }
    text = "  ".join(f"{key} {value:.3g}" for key, value in figures.items())
    given = {key: limit for key, limit in limits.items() if limit is not None}
    target = ", ".join(f"{key} <= {limit:g}" for key, limit in given.items())
    met = all(figures[key] <= limit for key, limit in given.items()) if given else None
    return Row(name, text, target, met)


def _single(name: str, value: float, limit: float | None) -> Row:
    if limit is None:
        return Row(name, f"{value:.3g}", "", None)
    return Row(name, f"{value:.3g}", f"<= {limit:g}", value <= limit)


def _print(section: Section, *, as_json: bool) -> None:
    out = sys.stderr if as_json else sys.stdout
    print_rows(f"{section.name}: {section.title}", section.rows, file=out)
    for note in section.notes:
        print(f"  not solved: {note}", file=out, flush=True)


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.accuracy.level", description=__doc__
    )
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    names = [scenario.name for scenario in (*SCENARIOS, *HARD)]
    parser.add_argument("--only", choices=[*names, "demo"], help="one scenario")
    parser.add_argument("--scenes", type=int, metavar="N", help="number of scenes of each scenario")
    parser.add_argument(
        "--hard", action="store_true", help="instead: scenes that may be refused but not be wrong"
    )
    parser.add_argument("--demo", action="store_true", help="the demo recording as well")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes (default 1)")
    parser.add_argument("--json", action="store_true", help="every run as JSON on stdout")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
