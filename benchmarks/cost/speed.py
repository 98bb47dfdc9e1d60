"""Cost of a calibration: CPU seconds by stage, peak memory, growth with size, start-up.

    python -m benchmarks.cost.speed                    the whole table
    python -m benchmarks.cost.speed --only base
    python -m benchmarks.cost.speed --json

Every scene is calibrated in a process of its own, on one thread. Exit status 1 if a target is
missed.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from statistics import median

import numpy as np

from benchmarks.cost.timing import Timing, in_own_process, startup_cpu_s
from stcalib_ros.core.options import Options
from stcalib_ros.core.synthetic import SceneOptions

_STARTUP_CPU_S = 0.5
"""Largest accepted CPU seconds of ``stcalib calibrate --help``: no noticeable wait."""


@dataclass(frozen=True, slots=True)
class Case:
    """A problem size and the limits of its cost.

    Attributes
    ----------
    name, title : str
    scene : SceneOptions
        Options of the first scene; the others differ in their seed.
    n_scenes : int
    options : Options
    without_3d : bool
        Only the keypoints are given, not the monocular 3D poses.
    cpu_s : float or None
        Largest accepted median of the CPU seconds.
    peak_mb : float or None
        Largest accepted peak of resident memory, MB.
    solve_mb : float or None
        The same minus the memory resident before the calibration.
    """

    name: str
    title: str
    scene: SceneOptions
    n_scenes: int = 3
    options: Options = field(default_factory=Options)
    without_3d: bool = False
    cpu_s: float | None = None
    peak_mb: float | None = None
    solve_mb: float | None = None


_BASE = SceneOptions(seed=1000)

_WITH_3D = (
    Case("base", "4 cameras, 3 people, 300 frames", _BASE, 5, cpu_s=1.2),
    Case("frames-1000", "1,000 frames", replace(_BASE, n_frames=1000), 3),
    Case("frames-3000", "3,000 frames", replace(_BASE, n_frames=3000), 3, cpu_s=12.0),
    Case("cameras-8", "8 cameras", replace(_BASE, n_cameras=8), 3),
    Case("cameras-12", "12 cameras", replace(_BASE, n_cameras=12), 3, cpu_s=5.0),
    Case("people-6", "6 people", replace(_BASE, n_people=6), 3),
    Case("people-12", "12 people", replace(_BASE, n_people=12), 3, cpu_s=4.0),
    Case("narrow", "offsets within 0.33 s", _BASE, 5, Options(offset_range_s=0.33)),
    Case("wide", "offsets within 10 s", _BASE, 5, Options(offset_range_s=10.0)),
    Case(
        "live",
        "12 cameras, 6 people, 900 frames",
        replace(_BASE, n_cameras=12, n_people=6, n_frames=900),
        1,
        solve_mb=400.0,
    ),
    Case(
        "large",
        "12 cameras, 12 people, 3,000 frames",
        replace(_BASE, n_cameras=12, n_people=12, n_frames=3000),
        1,
        peak_mb=1000.0,
    ),
)

CASES = _WITH_3D + tuple(
    replace(case, name=f"{case.name}-2d", title=f"{case.title}, 2D only", without_3d=True)
    for case in _WITH_3D
)
"""In the order of the table: with monocular 3D poses, and without."""


@dataclass(frozen=True, slots=True)
class Growth:
    """Growth of the cost with one size: exponent of a power law fitted to some cases."""

    name: str
    sizes: Mapping[str, int]
    limit: float


_SIZES = {
    "frames": ({"base": 300, "frames-1000": 1000, "frames-3000": 3000}, 1.1),
    "cameras": ({"base": 4, "cameras-8": 8, "cameras-12": 12}, 2.0),
    "people": ({"base": 3, "people-6": 6, "people-12": 12}, 2.0),
}
"""Sizes of the cases of each growth, and the largest accepted exponents."""

GROWTHS = tuple(
    Growth(f"{name}{how}", {f"{case}{suffix}": n for case, n in sizes.items()}, limit)
    for suffix, how in (("", ""), ("-2d", ", 2D only"))
    for name, (sizes, limit) in _SIZES.items()
)

RATIOS = (("wide", "narrow", 1.3), ("wide-2d", "narrow-2d", 1.3))
"""Two cases whose CPU seconds are compared, and the largest accepted ratio."""


@dataclass(frozen=True, slots=True)
class Row:
    """One figure and its upper limit; `met` is None without a limit."""

    figure: str
    value: float
    target: float | None

    @property
    def met(self) -> bool | None:
        """Whether the figure is within its limit."""
        return None if self.target is None else bool(self.value <= self.target)


@dataclass(frozen=True, slots=True)
class Section:
    """The figures of one case."""

    name: str
    title: str
    rows: tuple[Row, ...]
    stages: Mapping[str, float]
    notes: tuple[str, ...] = ()


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark and print the table.

    Returns
    -------
    int
        0 if all targets are met and all scenes are solved, else 1.
    """
    args = _arguments(argv)
    sections = []
    for case in CASES:
        if args.only in (None, case.name):
            sections.append(summary(case, measured(case, args.scenes or case.n_scenes)))
            _print(sections[-1], as_json=args.json)
    sections += comparisons({s.name: s for s in sections})
    if args.only in (None, "start"):
        rows = (Row("CPU s", startup_cpu_s(), _STARTUP_CPU_S),)
        sections.append(Section("start", "stcalib calibrate --help", rows, {}))
    for section in sections:
        if not section.stages:
            _print(section, as_json=args.json)
    if args.json:
        print(json.dumps([asdict(s) for s in sections], indent=2))
    missed = any(row.met is False for s in sections for row in s.rows)
    return 1 if missed or any(s.notes for s in sections) else 0


def measured(case: Case, n_scenes: int) -> list[Timing]:
    """Calibrate the scenes of a case, each in its own process."""
    seeds = range(case.scene.seed, case.scene.seed + n_scenes)
    return [
        in_own_process(replace(case.scene, seed=seed), case.options, without_3d=case.without_3d)
        for seed in seeds
    ]


def summary(case: Case, timings: Sequence[Timing]) -> Section:
    """Return the median CPU seconds and the largest memory of a case beside its targets."""
    names = dict.fromkeys(name for t in timings for name in t.stages)
    stages = {name: median(t.stages.get(name, 0.0) for t in timings) for name in names}
    rows = (
        Row("CPU s", median(t.cpu_s for t in timings), case.cpu_s),
        Row("peak MB", max(t.peak_mb for t in timings), case.peak_mb),
        Row("solve MB", max(t.solve_mb for t in timings), case.solve_mb),
    )
    notes = tuple(
        f"seed {case.scene.seed + k}: {t.failure}" for k, t in enumerate(timings) if t.failure
    )
    return Section(case.name, case.title, rows, stages, notes)


def comparisons(cases: Mapping[str, Section]) -> list[Section]:
    """Return growth exponents and the cost of a wide offset range, for cases that were run."""
    cost = {name: section.rows[0].value for name, section in cases.items()}
    found = [
        Section(
            f"growth in {growth.name}",
            " ".join(f"{n}: {cost[name]:.2f} s" for name, n in growth.sizes.items()),
            (Row("exponent", exponent(growth, cost), growth.limit),),
            {},
        )
        for growth in GROWTHS
        if growth.sizes.keys() <= cost.keys()
    ]
    for above, below, limit in RATIOS:
        if {above, below} <= cost.keys():
            row = Row("ratio", cost[above] / cost[below], limit)
            found.append(Section("offset range", f"CPU s, {above} over {below}", (row,), {}))
    return found


def exponent(growth: Growth, cost: Mapping[str, float]) -> float:
    """Fit the slope of log cost over log size by least squares."""
    x = np.log([float(n) for n in growth.sizes.values()])
    y = np.log([cost[name] for name in growth.sizes])
    return float(np.polyfit(x, y, 1)[0])


def _print(section: Section, *, as_json: bool) -> None:
    out = sys.stderr if as_json else sys.stdout
    print(f"\n{section.name}: {section.title}", file=out)
    for row in section.rows:
        target = "" if row.target is None else f"<= {row.target:g}"
        verdict = {True: "pass", False: "MISS", None: ""}[row.met]
        print(f"  {row.figure:24s} {row.value:9.2f}   {target:10s} {verdict}", file=out)
    for stage, cpu_s in section.stages.items():
        print(f"    {stage:22s} {cpu_s:9.2f}", file=out)
    for note in section.notes:
        print(f"  not solved: {note}", file=out)
    out.flush()


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.cost.speed", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    names = [case.name for case in CASES]
    parser.add_argument("--only", choices=[*names, "start"], help="one case")
    parser.add_argument("--scenes", type=int, metavar="N", help="scenes of each case")
    parser.add_argument("--json", action="store_true", help="the figures as JSON on stdout")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
