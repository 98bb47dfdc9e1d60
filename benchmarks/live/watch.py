"""Monitoring of a calibration in use: detection of changes, false alarms, CPU time.

    python -m benchmarks.live.watch                       20 runs each, and 20 of 10 minutes
    python -m benchmarks.live.watch --runs 2 --minutes 1  a short look
    python -m benchmarks.live.watch --only undisturbed --jobs 2

The calibration to monitor is estimated from the first seconds of each scene. A third of the scenes
has 3 px of noise, a third has a keypoint bias of 20 mm, and in the last third 5 people occlude each
other, leave the views, and are lost and exchanged by the trackers.

Exit status 1 if a target is missed.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.table import Row, finite, print_rows
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.recording import Recording, excerpt
from stcalib_ros.core.monitoring.alarms import State, Thresholds, Verdict, judge
from stcalib_ros.core.monitoring.limits import KEPT_SPANS, SPAN_S
from stcalib_ros.core.monitoring.spans import Span, check_span
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.synthetic import CameraChange, Scene, SceneOptions, simulate
from stcalib_ros.io.mocap import shipped_clips

FPS = 30.0
"""Frame rate of the simulated cameras, Hz."""
CALIBRATED_S = (15.0, 30.0)
"""Seconds of data for the calibration; the longer one if the shorter is refused."""
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
MIN_SCORE = 0.3
"""Score from which keypoints are used, that of the default options."""

KINDS: dict[str, dict[str, Any]] = {
    "noise": {},
    "bias": {"keypoint_bias_mm": 20.0, "occlusions": True},
    "crowd": {
        "n_people": 5,
        "area_radius_m": 2.5,
        "keypoint_bias_mm": 20.0,
        "occlusions": True,
        "missing": 0.25,
        "bursts_per_10s": 1.0,
        "id_switches_per_10s": 0.5,
    },
}

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
    failure: str = ""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark and print the table.

    Returns
    -------
    int
        0 if all targets are met, else 1.
    """
    args = _arguments(argv)
    names = [name for name in _TITLES if args.only in (None, name)]
    met, all_runs = True, []
    for name in names:
        task = partial(run, name, minutes=args.minutes)
        n = min(args.runs, _COST_RUNS) if name == "cost" else args.runs
        scenes = range(args.first, args.first + n)
        if args.jobs == 1:
            runs = [task(k) for k in scenes]
        else:
            with ProcessPoolExecutor(args.jobs) as pool:
                runs = list(pool.map(task, scenes))
        rows = summary(name, runs)
        out = sys.stderr if args.json else sys.stdout
        print_rows(f"{name}: {_TITLES[name]}", rows, file=out)
        for note in _notes(runs):
            print(f"  {note}", file=out, flush=True)
        met &= all(row.met is not False for row in rows)
        all_runs += runs
    if args.json:
        print(json.dumps(finite([asdict(r) for r in all_runs]), indent=2))
    return 0 if met else 1


_TITLES = {
    "turn": f"one of 4 cameras turned by {TURN_DEG:g} degrees about any axis",
    "clock": f"one of 4 clocks jumps by {1e3 * JUMP_S:g} ms",
    "undisturbed": "nothing happens",
    "cost": "12 cameras and 6 people, calibration as it is true",
}


def run(name: str, index: int, *, minutes: float) -> Run:
    """Simulate a scene, calibrate its beginning and monitor the rest."""
    kind = "many" if name == "cost" else list(KINDS)[index % len(KINDS)]
    seed = 9000 + 100 * list(_TITLES).index(name) + index
    watched_s = 60.0 * minutes if name == "undisturbed" else QUIET_S + WITHIN_S + SPAN_S
    start_s = 0.0 if name == "cost" else CALIBRATED_S[-1]
    given = MANY if name == "cost" else KINDS[kind]
    options = SceneOptions(seed=seed, n_frames=round(FPS * (start_s + watched_s)), fps=FPS, **given)
    change = _change(name, seed)
    scene = simulate(options, clips=shipped_clips(), changes=change)
    names = scene.rig.names
    camera = names[change[0].camera] if change else ""
    calibration = scene.truth if name == "cost" else _calibration(scene)
    if calibration.status is not Status.OK or len(calibration.cameras) < len(names):
        return Run(name, seed, kind, camera, failure=calibration.message)
    at_s = change[0].at_s if change else float("inf")
    begin = time.process_time()
    verdicts = list(watched(scene.recording, calibration, start_s))
    cpu_s = time.process_time() - begin
    return _judged(Run(name, seed, kind, camera, checked_s=watched_s, cpu_s=cpu_s), verdicts, at_s)


def _change(name: str, seed: int) -> tuple[CameraChange, ...]:
    rng = np.random.default_rng(seed)
    camera, at_s = seed % 4, CALIBRATED_S[-1] + QUIET_S + rng.uniform(-SPAN_S, 0.0)
    axis = rng.standard_normal(3)
    turn = np.radians(TURN_DEG) * axis / np.linalg.norm(axis)
    if name == "turn":
        return (CameraChange(camera, at_s, turn_rad=(turn[0], turn[1], turn[2])),)
    if name == "clock":
        return (CameraChange(camera, at_s, clock_s=JUMP_S * float(rng.choice([-1, 1]))),)
    return ()


def _calibration(scene: Scene) -> Calibration:
    for length_s in CALIBRATED_S:
        found = calibrate(excerpt(scene.recording, 0.0, length_s))
        if found.status is Status.OK and len(found.cameras) == len(scene.rig.names):
            break
    return found


def watched(
    recording: Recording, calibration: Calibration, start_s: float
) -> Iterator[tuple[float, dict[str, Verdict]]]:
    """End of every span, seconds since the epoch, and the verdicts after it."""
    offsets = {camera.name: camera.time_offset_s for camera in calibration.cameras}
    epoch_s = recording.epoch_ns * 1e-9
    verdicts = {camera.name: Verdict(camera.name) for camera in calibration.cameras}
    spans: list[Span] = []
    while start_s + SPAN_S <= recording.cameras[0].stamps[-1]:
        end_s = start_s + SPAN_S
        part = excerpt(recording, start_s, end_s, offsets_s=offsets)
        span = check_span(
            part,
            calibration,
            start_s=epoch_s + start_s,
            end_s=epoch_s + end_s,
            min_score=MIN_SCORE,
        )
        spans = [*spans, span][-KEPT_SPANS:]
        verdicts = judge(spans, verdicts, Thresholds())
        yield end_s, verdicts
        start_s = end_s


def _judged(run: Run, verdicts: list[tuple[float, dict[str, Verdict]]], at_s: float) -> Run:
    wanted = {"turn": State.MOVED, "clock": State.CLOCK}.get(run.name)
    false: dict[str, str] = {}
    detected_s, sentence = float("nan"), ""
    for end_s, found in verdicts:
        for name, verdict in found.items():
            if not verdict.state.alarm:
                continue
            if name == run.camera and end_s > at_s:
                if verdict.state is wanted and not verdict.suspects and not sentence:
                    detected_s, sentence = end_s - at_s, verdict.sentence()
            else:
                false.setdefault(name, f"{end_s:.0f} s: {verdict.sentence()}")
    return replace(
        run, false_alarms=tuple(false.values()), detected_s=detected_s, sentence=sentence
    )


def summary(name: str, runs: Sequence[Run]) -> tuple[Row, ...]:
    """Return the figures of the runs of one name beside their targets."""
    n = len(runs)
    watched_runs = sum(not r.failure for r in runs)
    alarms = sum(bool(r.false_alarms) for r in runs)
    rows = [Row("calibrated", f"{watched_runs} of {n}", f"{n}", watched_runs == n)]
    if name in ("turn", "clock"):
        times = [r.detected_s for r in runs]
        hits = sum(t <= WITHIN_S for t in times)
        rows.append(Row("right alarm", f"{hits} of {n}", f"{n} in {WITHIN_S:g} s", hits == n))
        if known := [t for t in times if np.isfinite(t)]:
            after = f"median {np.median(known):.1f}  max {max(known):.1f}"
            rows.append(Row("after s", after, "", None))
    rows.append(Row("false alarms", f"in {alarms} of {n}", "0", alarms == 0))
    load = sum(r.cpu_s for r in runs) / max(sum(r.checked_s for r in runs), 1e-9)
    met = load <= MAX_CPU_FRACTION
    rows.append(Row("CPU", f"{load:.1%} of a core", f"<= {MAX_CPU_FRACTION:.0%}", met))
    return tuple(rows)


def _notes(runs: Sequence[Run]) -> tuple[str, ...]:
    out = []
    for r in runs:
        out += [f"seed {r.seed}, {r.kind}: {alarm}" for alarm in r.false_alarms]
        if r.failure:
            out.append(f"seed {r.seed}, {r.kind}: not calibrated: {r.failure}")
        elif r.camera and not r.detected_s <= WITHIN_S:
            out.append(f"seed {r.seed}, {r.kind}: no alarm about {r.camera}")
    return tuple(out)


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.live.watch", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--only", choices=list(_TITLES), help="one part")
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
