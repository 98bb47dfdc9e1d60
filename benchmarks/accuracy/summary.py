"""Figures of some runs beside their targets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from benchmarks.accuracy.measure import Outcome, Run
from benchmarks.accuracy.real import RealCase
from benchmarks.accuracy.scenarios import MAX_2D_RATIO, MAX_CPU_S, MAX_RATIO, Scenario
from benchmarks.table import Row
from stcalib_ros.core.evaluation.metrics import Evaluation, match_quality
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.synthetic import SceneOptions

_ERRORS = ("E_R", "E_t", "E_delta")


@dataclass(frozen=True, slots=True)
class Section:
    """The figures of one scenario, with its 3D poses ("3d") or without ("2d")."""

    name: str
    title: str
    rows: tuple[Row, ...]
    notes: tuple[str, ...]
    runs: tuple[Run, ...]
    poses: str = "3d"


@dataclass(frozen=True, slots=True)
class Targets:
    """What the runs of a scenario have to reach.

    Attributes
    ----------
    solved : int or None
        Smallest number of scenes to be solved.
    may_refuse : bool
        Whether refusing a scene counts as much as solving it.
    medians, p90 : mapping of str to float
        Largest accepted medians and 90th percentiles of the errors.
    """

    solved: int | None
    may_refuse: bool
    medians: Mapping[str, float] = field(default_factory=dict)
    p90: Mapping[str, float] = field(default_factory=dict)


def summary(scenario: Scenario, runs: Sequence[Run], clean: Sequence[Run] = ()) -> Section:
    """Summarize the scenes of a scenario beside their targets.

    Parameters
    ----------
    scenario : Scenario
    runs : sequence of Run
    clean : sequence of Run
        Runs of the easier scenario of the same seeds, if any.
    """
    needed = _at_least(scenario.success, len(runs))
    targets = Targets(needed, scenario.may_refuse, scenario.medians, scenario.p90)
    rows = _rows(scenario, targets, runs, clean)
    return Section(scenario.name, scenario.title, rows, notes_of(runs), tuple(runs))


def summary_2d(
    scenario: Scenario,
    runs: Sequence[Run],
    clean: Sequence[Run] = (),
    with_3d: Sequence[Run] = (),
) -> Section:
    """Summarize the same scenes without their 3D poses.

    Parameters
    ----------
    scenario : Scenario
    runs, clean : sequence of Run
        As for `summary`, without 3D poses.
    with_3d : sequence of Run
        Runs of the same scenes with their 3D poses; without these, targets relative to them are
        left out.
    """
    rows = _rows(scenario, targets_2d(scenario, len(runs), with_3d), runs, clean)
    if with_3d:
        ratio = median_cpu(runs) / median_cpu(with_3d)
        rows += (Row("CPU / with 3D", f"{ratio:.2f}", "", None),)
    return Section(scenario.name, scenario.title, rows, notes_of(runs), tuple(runs), "2d")


def targets_2d(scenario: Scenario, n: int, with_3d: Sequence[Run]) -> Targets:
    """Return the targets of n scenes without 3D poses."""
    own = scenario.keypoints_only
    if own is not None:
        return Targets(_at_least(own.success, n), scenario.may_refuse, own.medians)
    if not with_3d:
        return Targets(None, scenario.may_refuse)
    usual = {name: float(np.median(errors_of(with_3d, name))) for name in _ERRORS}
    medians = {name: MAX_2D_RATIO * value for name, value in usual.items() if value > 0.0}
    return Targets(max(0, sum(not run.failure for run in with_3d) - 1), False, medians)


def real_section(case: RealCase, truth: Calibration, outcome: Outcome, run: Run) -> Section:
    """Summarize the calibration of a real recording beside its targets."""
    errors, found = run.evaluation, outcome.calibration
    figures = {} if errors is None else _real_figures(errors)
    refused = bool(run.failure)
    beyond = [name for name, limit in case.wrong.items() if not figures.get(name, 0.0) <= limit]
    wrong = not refused and bool(beyond)
    solved = Row("solved", "no" if refused else "yes", "yes", not refused)
    if case.may_refuse:
        solved = Row("solved", "no" if refused else "yes", "yes, or refused", True)
    rows = [solved, Row("wrong, but OK", f"{int(wrong)}", "0", not wrong)]
    limits = {} if refused and case.may_refuse else case.limits
    rows += [single(name, value, limits.get(name)) for name, value in figures.items()]
    if errors is not None and found is not None:
        seen_by_all = [p for p in truth.persons if len(p.tracks) == len(truth.cameras)]
        names = [camera.name for camera in truth.cameras]
        _, _, recall = match_quality(found.persons, seen_by_all, names)
        asked = not (refused and case.may_refuse)
        rows.append(_whole("precision", errors.precision, asked=asked))
        rows.append(_whole("people found", recall, asked=asked))
    rows.append(single("CPU s", run.cpu_s, MAX_CPU_S))
    return Section(case.name, case.title, tuple(rows), notes_of([run]), (run,))


def _real_figures(errors: Evaluation) -> dict[str, float]:
    return {
        "E_R": errors.E_R,
        "E_t": errors.E_t,
        "centres m": errors.centre_max,
        "offset frames": max(abs(camera.offset_frames) for camera in errors.cameras),
        **({} if math.isnan(errors.E_f) else {"E_f": errors.E_f}),
    }


def _whole(figure: str, value: float, *, asked: bool) -> Row:
    """Return the row of a fraction that has to be 1."""
    return Row(figure, f"{value:.3f}", "1" if asked else "", value == 1 if asked else None)


def _rows(
    scenario: Scenario, targets: Targets, runs: Sequence[Run], clean: Sequence[Run]
) -> tuple[Row, ...]:
    n, wrong = len(runs), sum(run.wrong for run in runs)
    solved = sum(not run.failure for run in runs)
    good, how = (n - wrong, " or refused") if targets.may_refuse else (solved, "")
    needed = targets.solved
    target, met = ("", None) if needed is None else (f">= {needed}{how}", good >= needed)
    rows = [
        Row("solved", f"{solved} of {n}", target, met),
        Row("wrong, but OK", f"{wrong}", "0", wrong == 0),
    ]
    for name in _ERRORS:
        values = errors_of(runs, name)
        limits = {"median": targets.medians.get(name), "p90": targets.p90.get(name)}
        rows.append(distribution(name, values, limits))
        usual = float(np.median(errors_of(clean[:n], name))) if clean else 0.0
        if usual > 0.0 and scenario.cpu_ratio is None:
            ratio = float(np.median(values)) / usual
            unknown = unobservable_frames(scenario.options) if name == "E_delta" else 0.0
            limit = MAX_RATIO + unknown / usual
            rows.append(single(f"{name} / {scenario.beside}", ratio, limit))
    precision = [r.evaluation.precision if r.evaluation else 0.0 for r in runs]
    rows.append(Row("precision", f"median {np.median(precision):.3f}", "", None))
    cpu_limits = {"median": scenario.cpu_s, "max": scenario.max_cpu_s}
    rows.append(distribution("CPU s", [r.cpu_s for r in runs], cpu_limits))
    if clean and scenario.cpu_ratio is not None:
        ratio = median_cpu(runs) / median_cpu(clean[:n])
        rows.append(single(f"CPU / {scenario.beside}", ratio, scenario.cpu_ratio))
    return tuple(rows)


def unobservable_frames(options: SceneOptions) -> float:
    """Return the mean E_delta that timestamp jitter leaves in any estimate, frames.

    The mean error of the stamps of a clock moves all of its images; it is not observable.
    """
    rates = options.rates(options.n_cameras)
    n = options.n_frames * np.array(rates) / rates[0] * (1.0 - options.drop_rate)
    variance = options.stamp_jitter_s**2 / n
    spread = np.sqrt(variance[1:] + variance[0])
    return float(np.sqrt(2.0 / np.pi) * spread.mean() * rates[0])


def _at_least(fraction: Fraction, n: int) -> int:
    """Return the number of n scenes that a fraction asks for, rounded up."""
    return n - int((1 - fraction) * n)


def median_cpu(runs: Sequence[Run]) -> float:
    """Return the median of the CPU seconds."""
    return float(np.median([run.cpu_s for run in runs]))


def notes_of(runs: Sequence[Run]) -> tuple[str, ...]:
    """Return a line for every scene that is not solved, with the codes of the reasons."""
    return tuple(
        f"seed {run.seed}: {run.failure}" + "".join(f" [{code}]" for code in run.codes)
        for run in runs
        if run.failure
    )


def errors_of(runs: Sequence[Run], name: str) -> list[float]:
    """Return one error of every scene; infinite where there is no calibration."""
    return [getattr(r.evaluation, name) if r.evaluation else np.inf for r in runs]


def distribution(name: str, values: Sequence[float], limits: Mapping[str, float | None]) -> Row:
    """Return the row of median, 90th percentile and largest of some values."""
    figures = {
        "median": float(np.median(values)),
        "p90": float(np.percentile(values, 90, method="nearest")),
        "max": float(np.max(values)),
    }
    text = "  ".join(f"{key} {value:.3g}" for key, value in figures.items())
    given = {key: limit for key, limit in limits.items() if limit is not None}
    target = ", ".join(f"{key} <= {limit:.3g}" for key, limit in given.items())
    met = all(figures[key] <= limit for key, limit in given.items()) if given else None
    return Row(name, text, target, met)


def single(name: str, value: float, limit: float | None) -> Row:
    """Return the row of one value and its limit, if there is one."""
    if limit is None:
        return Row(name, f"{value:.3g}", "", None)
    return Row(name, f"{value:.3g}", f"<= {limit:.3g}", value <= limit)
