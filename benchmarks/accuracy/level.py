"""The accuracy that the project promises, in one table.

    python -m benchmarks.accuracy.level                    all simulated scenes
    python -m benchmarks.accuracy.level --real             and the real recordings
    python -m benchmarks.accuracy.level --only default --scenes 5
    python -m benchmarks.accuracy.level --poses 2d         without 3D poses
    python -m benchmarks.accuracy.level --hard             200 scenes that must not be wrong
    python -m benchmarks.accuracy.level --intrinsics unknown    lenses are to be found as well

Every scene is calibrated twice: with its monocular 3D poses, and with its keypoints only.
With --intrinsics, the scenes are others, and each is calibrated with its true lenses as well, which
errors and CPU seconds are compared with. Exit status 1 if a target is missed.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial

from benchmarks.accuracy.lens_summary import beside_given, lens_section
from benchmarks.accuracy.lenses import (
    LENS_SCENARIOS,
    LensScenario,
    run_lens_scene,
    without_lenses,
)
from benchmarks.accuracy.measure import judged, run_calibration, run_scene, run_scenes
from benchmarks.accuracy.real import DEMO, DEMO_2D, KEYPOINT_CASES, REAL_LENSES, RealCase
from benchmarks.accuracy.scenarios import HARD, SCENARIOS, Scenario
from benchmarks.accuracy.summary import Section, real_section, summary, summary_2d
from benchmarks.table import finite, print_beside
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.recording import keypoints_only
from stcalib_ros.core.options import Options

_HEADINGS = {"3d": "with 3D poses", "2d": "2D only"}
_REAL = {"3d": (DEMO,), "2d": (DEMO_2D, *KEYPOINT_CASES)}
"""Real recordings, by the poses that are used of them."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark and print the table.

    Returns
    -------
    int
        0 if all targets are met, else 1.
    """
    args = _arguments(argv)
    poses = tuple(_HEADINGS) if args.poses == "both" else (args.poses,)
    sections: list[Section] = []
    for found in _with_estimated_lenses(args, poses) if args.intrinsics else _given(args, poses):
        _print(found, as_json=args.json)
        sections += found
    if args.json:
        print(json.dumps(finite([asdict(s) for s in sections]), indent=2))
    return 0 if all(row.met is not False for s in sections for row in s.rows) else 1


def _given(args: argparse.Namespace, poses: Sequence[str]) -> Iterator[list[Section]]:
    """Run the scenarios and recordings with given lenses, one after the other."""
    earlier: list[Section] = []
    for scenario in HARD if args.hard else SCENARIOS:
        if args.only is None or scenario.name in args.only:
            found = _simulated(scenario, poses, args, earlier)
            earlier += found
            yield found
    for cases in _chosen(args, {p: _REAL[p] for p in poses}):
        yield [real(case, p) for case, p in cases]


def _with_estimated_lenses(
    args: argparse.Namespace, poses: Sequence[str]
) -> Iterator[list[Section]]:
    """Run the scenes whose lenses are to be found, and the recordings."""
    knowledge = LensKnowledge(args.intrinsics)
    for kind in LENS_SCENARIOS:
        if args.only is None or kind.scenario.name in args.only:
            yield [_lenses(kind, knowledge, p, args) for p in poses]
    for cases in _chosen(args, {p: REAL_LENSES[knowledge][p] for p in poses}):
        yield [real_lenses(case, p, knowledge) for case, p in cases]


def _chosen(
    args: argparse.Namespace, recordings: Mapping[str, Sequence[RealCase]]
) -> Iterator[list[tuple[RealCase, str]]]:
    """List the recordings that are asked for, each with the poses that are used of it."""
    for name in dict.fromkeys(case.name for cases in recordings.values() for case in cases):
        if args.real or name in (args.only or ()):
            yield [(c, p) for p, cases in recordings.items() for c in cases if c.name == name]


def real(case: RealCase, poses: str) -> Section:
    """Calibrate a real recording, with its "3d" poses or with "2d" ones only."""
    recording, truth = case.read()
    outcome = run_calibration(recording if poses == "3d" else keypoints_only(recording))
    run = judged(outcome, truth, name=case.name, seed=0, fps=case.fps, bounds={})
    return replace(real_section(case, truth, outcome, run), poses=poses)


def real_lenses(case: RealCase, poses: str, knowledge: LensKnowledge) -> Section:
    """Calibrate a real recording with its lenses, and with less known of them, in turn."""
    recording, truth = case.read()
    if poses == "2d":
        recording = keypoints_only(recording)
    sizes_only = knowledge is LensKnowledge.UNKNOWN
    outcomes = (
        run_calibration(recording),
        run_calibration(
            without_lenses(recording) if sizes_only else recording,
            Options(intrinsics=knowledge.value, lens=case.lens),
        ),
    )
    given, run = (
        judged(one, truth, name=case.name, seed=0, fps=case.fps, bounds={}) for one in outcomes
    )
    section = replace(real_section(case, truth, outcomes[1], run), poses=poses)
    return replace(section, rows=(*section.rows, *beside_given(run, given, knowledge)))


def _lenses(
    kind: LensScenario, knowledge: LensKnowledge, poses: str, args: argparse.Namespace
) -> Section:
    """Run the scenes of a kind whose lenses are to be found."""
    runs = run_scenes(
        partial(run_lens_scene, kind, knowledge, poses),
        args.scenes or kind.scenario.n_scenes,
        title=f"{kind.scenario.name}, {poses}",
        jobs=args.jobs,
    )
    return lens_section(kind, runs, poses)


def _simulated(
    scenario: Scenario,
    poses: Sequence[str],
    args: argparse.Namespace,
    earlier: Sequence[Section],
) -> list[Section]:
    """Run the scenes of a scenario with each kind of poses."""
    runs = {
        kind: run_scenes(
            partial(run_scene, scenario, poses=kind),
            args.scenes or scenario.n_scenes,
            title=f"{scenario.name}, {kind}",
            jobs=args.jobs,
        )
        for kind in poses
    }
    clean = {section.poses: section.runs for section in earlier if section.name == scenario.beside}
    found = []
    if "3d" in runs:
        found.append(summary(scenario, runs["3d"], clean.get("3d", ())))
    if "2d" in runs:
        with_3d = runs.get("3d", ())
        found.append(summary_2d(scenario, runs["2d"], clean.get("2d", ()), with_3d))
    return found


def _print(sections: Sequence[Section], *, as_json: bool) -> None:
    out = sys.stderr if as_json else sys.stdout
    columns = [(_HEADINGS[section.poses], section.rows) for section in sections]
    print_beside(f"{sections[0].name}: {sections[0].title}", columns, file=out)
    for section in sections:
        for note in section.notes:
            print(f"  not solved, {_HEADINGS[section.poses]}: {note}", file=out, flush=True)


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.accuracy.level", description=__doc__
    )
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    names = [scenario.name for scenario in (*SCENARIOS, *HARD)]
    names += [kind.scenario.name for kind in LENS_SCENARIOS if kind.scenario.name not in names]
    names += [case.name for case in _REAL["2d"]]
    parser.add_argument(
        "--only", choices=names, nargs="+", help="these scenarios and real recordings"
    )
    parser.add_argument("--scenes", type=int, metavar="N", help="number of scenes of each scenario")
    parser.add_argument(
        "--poses", choices=[*_HEADINGS, "both"], default="both", help="default both"
    )
    parser.add_argument(
        "--hard", action="store_true", help="instead: scenes that may be refused but not be wrong"
    )
    parser.add_argument(
        "--intrinsics",
        choices=[LensKnowledge.REFINE.value, LensKnowledge.UNKNOWN.value],
        help="instead: scenes whose lenses are estimated, from a guess or from nothing",
    )
    parser.add_argument("--real", action="store_true", help="the real recordings as well")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes (default 1)")
    parser.add_argument("--json", action="store_true", help="every run as JSON on stdout")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
