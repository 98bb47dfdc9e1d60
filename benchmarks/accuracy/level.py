"""The accuracy that the project promises, in one table.

    python -m benchmarks.accuracy.level                    all simulated scenes
    python -m benchmarks.accuracy.level --real             and the real recordings
    python -m benchmarks.accuracy.level --only default --scenes 5
    python -m benchmarks.accuracy.level --poses 2d         without 3D poses
    python -m benchmarks.accuracy.level --hard             200 scenes that must not be wrong

Every scene is calibrated twice: with its monocular 3D poses, and with its keypoints only. Exit
status 1 if a target is missed.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial

from benchmarks.accuracy.measure import judged, run_calibration, run_scene, run_scenes
from benchmarks.accuracy.real import DEMO, DEMO_2D, KEYPOINT_CASES, RealCase
from benchmarks.accuracy.scenarios import HARD, SCENARIOS, Scenario
from benchmarks.accuracy.summary import Section, real_section, summary, summary_2d
from benchmarks.table import finite, print_beside
from stcalib_ros.core.model.recording import keypoints_only

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
    for scenario in HARD if args.hard else SCENARIOS:
        if args.only is None or scenario.name in args.only:
            found = _simulated(scenario, poses, args, sections)
            _print(found, as_json=args.json)
            sections += found
    for name in dict.fromkeys(case.name for p in poses for case in _REAL[p]):
        if args.real or name in (args.only or ()):
            cases = [(case, p) for p in poses for case in _REAL[p] if case.name == name]
            found = [real(case, p) for case, p in cases]
            _print(found, as_json=args.json)
            sections += found
    if args.json:
        print(json.dumps(finite([asdict(s) for s in sections]), indent=2))
    return 0 if all(row.met is not False for s in sections for row in s.rows) else 1


def real(case: RealCase, poses: str) -> Section:
    """Calibrate a real recording, with its "3d" poses or with "2d" ones only."""
    recording, truth = case.read()
    outcome = run_calibration(recording if poses == "3d" else keypoints_only(recording))
    run = judged(outcome, truth, name=case.name, seed=0, fps=case.fps, bounds={})
    return replace(real_section(case, truth, outcome, run), poses=poses)


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
    parser.add_argument("--real", action="store_true", help="the real recordings as well")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes (default 1)")
    parser.add_argument("--json", action="store_true", help="every run as JSON on stdout")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
