"""Monitoring of a calibration in use: detection of changes, false alarms, CPU time.

    python -m benchmarks.live.watch                       20 runs each, 2, 3 and 8 cameras
    python -m benchmarks.live.watch --runs 2 --minutes 1  a short look
    python -m benchmarks.live.watch --cameras 2 --only turn drift --jobs 2

Each run calibrates 30 s of a simulated scene whose trackers exchange ids and whose clocks differ by
up to 20 ppm, and monitors what follows. A third of the scenes has 3 px of noise, a third has a
keypoint bias of 20 mm, and in the last third people occlude each other, leave the views, and are
lost and exchanged by the trackers. Where such a scene is refused, the next one is calibrated.

Exit status 1 if a target is missed.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import IO, Any

import numpy as np

from benchmarks.live.watched_scenes import (
    CALIBRATED_S,
    FPS,
    SKEW_PPM,
    Calibrated,
    Timing,
    calibrated,
    watched,
    with_rates,
)
from benchmarks.table import Row, finite, print_rows
from stcalib_ros.core.monitoring.alarms import State, Verdict
from stcalib_ros.core.monitoring.limits import SPAN_S
from stcalib_ros.core.synthetic import CameraChange, SceneOptions, simulate
from stcalib_ros.io.mocap import shipped_clips

QUIET_S = 10.0
"""Seconds of monitoring before a camera changes."""
WITHIN_S = 10.0
"""Largest accepted time from a change to its alarm, s."""
MAX_CPU_FRACTION = 0.05
"""Largest accepted CPU seconds per second of monitored time."""
TURN_DEG = 2.0
"""Rotation of the camera that is turned, degrees."""
JUMP_S = 0.1
"""Jump of the clock that jumps, s."""
DAYS_S = 30 * 86_400.0
"""Seconds between a calibration that knows the rates of the clocks, and what is monitored."""
DRIFT_PAUSE_S = 120.0
"""Seconds between the spans of a clock that drifts, people being rare: 2.4 ms each."""
DRIFT_SPANS = 42
"""Spans of a clock that drifts, count: it comes to 100 ms in 84 minutes."""
MAX_DRIFT_S = 0.1
"""Advance at which a drift has to be said at last, s: twice the threshold of an alarm."""
CAMERAS = (2, 3, 8)
"""Numbers of cameras of the scenes."""

MANY: dict[str, Any] = {"n_cameras": 12, "n_people": 6, "area_radius_m": 2.0}
_COST_RUNS = 2
"""Runs that are enough to measure the CPU time."""


@dataclass(frozen=True, slots=True)
class Run:
    """One monitored scene.

    Attributes
    ----------
    name : str
    seed : int
    kind : str
    camera : str
        Camera that changes; empty if none does.
    false_alarms : tuple of str
        Alarms about cameras that have not changed (yet).
    detected_s : float
        Seconds from the change to the end of the span with the right alarm; NaN without one.
    sentence : str
        The right alarm.
    checked_s, cpu_s : float
        Monitored time, and the CPU seconds that monitoring took.
    n_refused : int
        Scenes that were refused before.
    failure : str
        Reason why there is no calibration to monitor.
    """

    name: str
    seed: int
    kind: str
    camera: str
    false_alarms: tuple[str, ...] = ()
    detected_s: float = float("nan")
    sentence: str = ""
    checked_s: float = 0.0
    cpu_s: float = 0.0
    n_refused: int = 0
    failure: str = ""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark and print the table.

    Returns
    -------
    int
        0 if all targets are met, else 1.
    """
    args = _arguments(argv)
    out = sys.stderr if args.json else sys.stdout
    names = [name for name in _TITLES if not args.only or name in args.only]
    met, all_runs = True, []
    for n_cameras in args.cameras:
        task = partial(runs_of, n_cameras, names=names, minutes=args.minutes)
        runs = [run for some in _each(task, args) for run in some]
        for name in names:
            own = [run for run in runs if run.name == name]
            met &= _print(f"{name}, {n_cameras} cameras: {_TITLES[name]}", own, file=out)
        all_runs += runs
    if not args.only or "cost" in args.only:
        runs = [cost(k) for k in range(min(args.runs, _COST_RUNS))]
        met &= _print("cost: 12 cameras and 6 people, calibration as it is true", runs, file=out)
        all_runs += runs
    if args.json:
        print(json.dumps(finite([asdict(r) for r in all_runs]), indent=2))
    return 0 if met else 1


def _each(
    task: Callable[[int], tuple[Run, ...]], args: argparse.Namespace
) -> Iterable[tuple[Run, ...]]:
    scenes = range(args.first, args.first + args.runs)
    if args.jobs == 1:
        return [task(k) for k in scenes]
    with ProcessPoolExecutor(args.jobs) as pool:
        return list(pool.map(task, scenes))


def _print(title: str, runs: Sequence[Run], *, file: IO[str]) -> bool:
    if not runs:
        return True
    rows = summary(runs[0].name, runs)
    print_rows(title, rows, file=file)
    for note in _notes(runs):
        print(f"  {note}", file=file, flush=True)
    return all(row.met is not False for row in rows)


_TITLES = {
    "turn": f"one of them turns by {TURN_DEG:g} degrees about any axis",
    "clock": f"the clock of one jumps by {1e3 * JUMP_S:g} ms",
    "undisturbed": "nothing happens",
    "days": "after 30 days of clocks whose rates are known, one turns or its clock jumps",
    "drift": f"the clock of one drifts by {SKEW_PPM:g} ppm, its rate is not known",
}
_NO_CHANGE = ("undisturbed", "drift")
"""Parts in which no camera changes during a span."""


def runs_of(n_cameras: int, index: int, *, names: Sequence[str], minutes: float) -> tuple[Run, ...]:
    """Calibrate one scene and monitor what follows, once for each name."""
    parts = [name for name in names if name in _TITLES]
    found = calibrated(n_cameras, index) if parts else None
    return tuple(run(name, found, index, minutes=minutes) for name in parts if found)


def run(name: str, found: Calibrated, index: int, *, minutes: float) -> Run:
    """Simulate the same cameras for longer, and monitor the time after the calibration."""
    seed, n_cameras = found.options.seed, found.options.n_cameras
    camera = seed % n_cameras
    one = Run(name, seed, found.kind, f"cam{camera}", n_refused=found.n_refused)
    if found.failure:
        return replace(one, failure=found.failure)
    seconds = {"undisturbed": 60.0 * minutes, "drift": SPAN_S * DRIFT_SPANS + SPAN_S}
    watched_s = seconds.get(name, QUIET_S + WITHIN_S + SPAN_S)
    changes = () if name in _NO_CHANGE else (_change(name, seed, camera),)
    options = replace(found.options, n_frames=round(FPS * (CALIBRATED_S + watched_s)))
    recording = simulate(options, clips=shipped_clips(), changes=changes).recording
    rates, calibration, timing = found.skew, found.calibration, Timing()
    if name == "days":
        calibration, timing = with_rates(calibration, rates), Timing(DAYS_S)
    if name == "drift":
        rate = 1e-6 * SKEW_PPM * (-1) ** index
        rates, timing = {one.camera: rate}, Timing(0.0, DRIFT_PAUSE_S)
    begin = time.process_time()
    verdicts = list(watched(recording, calibration, CALIBRATED_S, rates=rates, timing=timing))
    cpu_s = time.process_time() - begin
    at_s = min((change.at_s for change in changes), default=float("inf"))
    return _judged(replace(one, checked_s=watched_s, cpu_s=cpu_s), verdicts, at_s)


def cost(index: int) -> Run:
    """Monitor many cameras with their true calibration."""
    seed = 9300 + index
    scene = simulate(SceneOptions(seed=seed, n_frames=round(FPS * 22.0), fps=FPS, **MANY))
    begin = time.process_time()
    verdicts = list(watched(scene.recording, scene.truth, 0.0))
    cpu_s = time.process_time() - begin
    checked_s = SPAN_S * len(verdicts)
    one = Run("cost", seed, "many", "", checked_s=checked_s, cpu_s=cpu_s)
    return _judged(one, verdicts, float("inf"))


def _change(name: str, seed: int, camera: int) -> CameraChange:
    rng = np.random.default_rng(seed)
    at_s = CALIBRATED_S + QUIET_S + rng.uniform(-SPAN_S, 0.0)
    axis = rng.standard_normal(3)
    turn = np.radians(TURN_DEG) * axis / np.linalg.norm(axis)
    if name == "turn" or (name == "days" and seed % 2):
        return CameraChange(camera, at_s, turn_rad=(turn[0], turn[1], turn[2]))
    return CameraChange(camera, at_s, clock_s=JUMP_S * float(rng.choice([-1, 1])))


def _judged(run: Run, verdicts: list[tuple[float, dict[str, Verdict]]], at_s: float) -> Run:
    false: dict[str, str] = {}
    detected_s, sentence = float("nan"), ""
    for k, (end_s, found) in enumerate(verdicts):
        for name, verdict in found.items():
            if not verdict.state.alarm:
                continue
            if not _is_right(run, verdict, end_s > at_s):
                false.setdefault(name, f"{end_s:.0f} s: {verdict.sentence()}")
            elif not sentence:
                drift_s = 1e-6 * SKEW_PPM * DRIFT_PAUSE_S * k
                detected_s = drift_s if run.name == "drift" else end_s - at_s
                sentence = verdict.sentence()
    return replace(
        run, false_alarms=tuple(false.values()), detected_s=detected_s, sentence=sentence
    )


def _is_right(run: Run, verdict: Verdict, changed: bool) -> bool:
    """Whether an alarm is about the camera that has changed, or about it and another one."""
    if run.camera not in (verdict.suspects or (verdict.name,)):
        return False
    return verdict.state is State.DRIFTED if run.name == "drift" else changed


def summary(name: str, runs: Sequence[Run]) -> tuple[Row, ...]:
    """Return the figures of the runs of one name beside their targets."""
    n = len(runs)
    watched_runs = sum(not r.failure for r in runs)
    alarms = sum(bool(r.false_alarms) for r in runs)
    refused = sum(r.n_refused for r in runs)
    value = f"{watched_runs} of {n}" + (f", {refused} scenes refused before" if refused else "")
    rows = [Row("calibrated", value, f"{n}", watched_runs == n)]
    if name in ("turn", "clock", "days"):
        rows += _detections([r.detected_s for r in runs], "s", WITHIN_S)
    if name == "drift":
        rows += _detections([1e3 * r.detected_s for r in runs], "ms", 1e3 * MAX_DRIFT_S)
    rows.append(Row("false alarms", f"in {alarms} of {n}", "0", alarms == 0))
    if name in ("undisturbed", "cost"):
        load = sum(r.cpu_s for r in runs) / max(sum(r.checked_s for r in runs), 1e-9)
        limit = Row("CPU", f"{load:.1%} of a core", f"<= {MAX_CPU_FRACTION:.0%}", None)
        rows.append(replace(limit, met=load <= MAX_CPU_FRACTION) if name == "cost" else limit)
    return tuple(rows)


def _detections(values: Sequence[float], unit: str, limit: float) -> list[Row]:
    n, hits = len(values), sum(value <= limit for value in values)
    rows = [Row("right alarm", f"{hits} of {n}", f"{n} in {limit:g} {unit}", hits == n)]
    if known := [value for value in values if np.isfinite(value)]:
        after = f"median {np.median(known):.1f}  max {max(known):.1f}"
        rows.append(Row(f"after {unit}", after, "", None))
    return rows


def _notes(runs: Sequence[Run]) -> tuple[str, ...]:
    out = []
    for r in runs:
        out += [f"seed {r.seed}, {r.kind}: {alarm}" for alarm in r.false_alarms]
        if r.failure:
            out.append(f"seed {r.seed}, {r.kind}: not calibrated: {r.failure}")
        elif r.name not in ("undisturbed", "cost") and not r.sentence:
            out.append(f"seed {r.seed}, {r.kind}: no alarm about {r.camera}")
    return tuple(out)


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.live.watch", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--only", choices=[*_TITLES, "cost"], nargs="+", help="some parts")
    parser.add_argument(
        "--cameras", type=int, nargs="+", default=CAMERAS, metavar="C", help="default 2 3 8"
    )
    parser.add_argument("--runs", type=int, default=20, metavar="N", help="of each (default 20)")
    parser.add_argument(
        "--first", type=int, default=0, metavar="K", help="begin with run K: other scenes"
    )
    parser.add_argument(
        "--minutes", type=float, default=10.0, metavar="M", help="of undisturbed runs (default 10)"
    )
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes (default 1)")
    parser.add_argument("--json", action="store_true", help="every run as JSON on stdout")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
