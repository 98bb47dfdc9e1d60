"""Errors of the pipeline beside the Cramer-Rao bound of each scene.

    python -m benchmarks.accuracy.cramer_rao
    python -m benchmarks.accuracy.cramer_rao --only default --scenes 5

The bound (`stcalib_ros.core.evaluation.cramer_rao`) is computed with the true cameras, trajectories
and identities, and expressed as the mean error, in the pipeline's own metric, of an estimate with
that covariance. Two bounds are printed. The target is the ratio to the bound with free points, the
model that the bundle adjustment solves. The errors of a scene that is not solved count as infinite.
Timestamp jitter leaves the mean error of each clock's stamps unknown: this is part of the bound of
the time offsets, while the times of single images count as known. The distribution of errors is
skewed, so an estimate that attains the bound has a ratio of medians somewhat below 1; "on average"
is the mean of error over bound over the solved scenes, which is then 1. Exit status 1 if a target
is missed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial

import numpy as np

from benchmarks.accuracy.measure import Run, judged, run_calibration, run_scenes
from benchmarks.accuracy.scenarios import SCENARIOS, Scenario
from benchmarks.table import Row, print_rows
from stcalib_ros.core.bundle.covariance import OFFSET_ROW, rows_of
from stcalib_ros.core.evaluation.cramer_rao import (
    CramerRaoBound,
    ExpectedErrors,
    expected_errors,
    free_point_bound,
    spline_bound,
)
from stcalib_ros.core.evaluation.scene_truth import ScenePath, true_views
from stcalib_ros.core.synthetic import Scene, SceneOptions, simulate
from stcalib_ros.io.mocap import shipped_clips

_DEFAULT = SceneOptions(seed=1000)
_RATES = next(scenario for scenario in SCENARIOS if scenario.name == "rates")
_ERRORS = ("E_R", "E_t", "E_delta")


def _case(name: str, title: str, options: SceneOptions, ratio: float = 2.0) -> Scenario:
    return Scenario(name, title, options, 30, Fraction(29, 30), dict.fromkeys(_ERRORS, ratio))


CASES = (
    _case("default", "4 cameras, 3 people, 300 frames, 3 px", _DEFAULT, 1.5),
    _case("one", "one person", replace(_DEFAULT, n_people=1, seed=1100)),
    _case(
        "crowd",
        "6 people, 25 % missing per view",
        replace(_DEFAULT, n_people=6, area_radius_m=2.0, missing=0.25, seed=1200),
    ),
    *(
        _case(f"{n} cameras", f"{n} cameras", replace(_DEFAULT, n_cameras=n, seed=1300 + 50 * n))
        for n in (2, 8, 12)
    ),
    _case("rates", _RATES.title, _RATES.options),
)
"""The `medians` of a case are the largest accepted ratios of median error to median bound."""


@dataclass(frozen=True, slots=True)
class Compared:
    """One calibration, and the mean errors at the bounds of its scene."""

    run: Run
    free: ExpectedErrors
    spline: ExpectedErrors
    fps: float

    def bounds(self, error: str) -> tuple[float, float]:
        """Mean error at both bounds, in the unit of `Evaluation`."""
        if error == "E_delta":
            return self.free.E_delta_s * self.fps, self.spline.E_delta_s * self.fps
        return getattr(self.free, error), getattr(self.spline, error)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark and print the table; 0 if all targets are met, else 1."""
    args = _arguments(argv)
    met = True
    for case in CASES:
        if args.only in (None, case.name):
            n = args.scenes or case.n_scenes
            found = run_scenes(partial(compare, case), n, title=case.name, jobs=args.jobs)
            rows = summary(case, found)
            print_rows(f"{case.name}: {case.title}", rows, file=sys.stdout)
            for one in found:
                if one.run.failure:
                    print(f"  not solved: seed {one.run.seed}: {one.run.failure}", flush=True)
            met = met and all(row.met is not False for row in rows)
    return 0 if met else 1


def compare(case: Scenario, index: int) -> Compared:
    """Calibrate one scene of a case, and compute its bounds."""
    options = case.scene_options(index)
    scene = simulate(options, clips=shipped_clips())
    fps = options.rates(options.n_cameras)[0]
    outcome = run_calibration(scene.recording)
    run = judged(outcome, scene.truth, name=case.name, seed=options.seed, fps=fps)
    return Compared(run, *bounds(scene), fps)


def bounds(scene: Scene) -> tuple[ExpectedErrors, ExpectedErrors]:
    """Mean errors at the bounds of a scene, with free points and with splines."""
    views, path = true_views(scene), ScenePath(scene)
    free, spline = (
        expected_errors(_with_jitter(bound(views, path), scene), np.random.default_rng(0))
        for bound in (free_point_bound, spline_bound)
    )
    return free, spline


def _with_jitter(bound: CramerRaoBound, scene: Scene) -> CramerRaoBound:
    """Add the mean error of the stamps of every clock, which is not observable."""
    n = np.array([len(camera.stamps) for camera in scene.recording.cameras])
    variance = scene.options.stamp_jitter_s**2 / n
    offsets = rows_of(np.arange(1, len(n)))[:, OFFSET_ROW]
    covariance = bound.covariance.copy()
    covariance[np.ix_(offsets, offsets)] += np.diag(variance[1:]) + variance[0]
    return replace(bound, covariance=covariance)


def summary(case: Scenario, found: Sequence[Compared]) -> list[Row]:
    """Return the medians of errors and bounds, and their ratios beside the targets."""
    n, solved = len(found), sum(not one.run.failure for one in found)
    needed = n - int((1 - case.success) * n)
    wrong = sum(one.run.wrong for one in found)
    rows = [
        Row("solved", f"{solved} of {n}", f">= {needed}", solved >= needed),
        Row("wrong, but OK", f"{wrong}", "0", wrong == 0),
    ]
    good = [one for one in found if not one.run.failure]
    for error in _ERRORS:
        ours = float(
            np.median([np.inf if one.run.failure else _error(one, error) for one in found])
        )
        free, spline = np.median([one.bounds(error) for one in found], axis=0)
        ratio = [_error(one, error) / one.bounds(error)[0] for one in good]
        average = float(np.mean(ratio)) if good else np.inf
        text = f"{ours:.3g}  free points {free:.3g}  spline {spline:.3g}"
        limit = case.medians[error]
        met = bool(ours / free <= limit)
        rows.append(Row(error, text, "", None))
        text = f"free points {ours / free:.2f}x  spline {ours / spline:.2f}x"
        rows.append(Row("", f"{text}  on average {average:.2f}x", f"<= {limit:g}x free", met))
    return rows


def _error(one: Compared, name: str) -> float:
    return float(getattr(one.run.evaluation, name))


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.accuracy.cramer_rao", description=__doc__
    )
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--only", choices=[case.name for case in CASES], help="one case")
    parser.add_argument("--scenes", type=int, metavar="N", help="scenes of each case (default 30)")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes (default 1)")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
