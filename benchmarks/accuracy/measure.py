"""One scene, calibrated and compared with the truth."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

from benchmarks.accuracy.scenarios import SUCCESS, Scenario
from stcalib_ros.core.errors import StcalibError
from stcalib_ros.core.evaluation.metrics import Evaluation, evaluate
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.recording import Recording, keypoints_only
from stcalib_ros.core.model.rolling_shutter import with_known_line_times
from stcalib_ros.core.options import Options
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.synthetic import simulate
from stcalib_ros.io.mocap import shipped_clips

_T = TypeVar("_T")


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """Result of a calibration.

    Attributes
    ----------
    calibration : Calibration or None
    cpu_s : float
        CPU seconds of the calibration alone.
    refusal : str
        Error message if there is no result.
    """

    calibration: Calibration | None
    cpu_s: float
    refusal: str


@dataclass(frozen=True, slots=True)
class Run:
    """One calibration beside the truth.

    Attributes
    ----------
    scenario : str
    seed : int
    cpu_s : float
        CPU seconds of the calibration alone.
    evaluation : Evaluation or None
        None if there is no result to compare.
    failure : str
        Reason why the scene is not solved; empty if it is.
    wrong : bool
        Whether the status is OK although the errors exceed the targets.
    codes : tuple of str
        Codes of the reasons for a rejection, of the calibration and of single cameras.
    """

    scenario: str
    seed: int
    cpu_s: float
    evaluation: Evaluation | None
    failure: str
    wrong: bool = False
    codes: tuple[str, ...] = ()


def run_scene(scenario: Scenario, index: int, poses: str = "3d") -> Run:
    """Simulate and calibrate one scene of a scenario, with "3d" poses or with "2d" ones only."""
    options = scenario.scene_options(index)
    scene = simulate(options, clips=shipped_clips())
    if scenario.alter is not None:
        scene = scenario.alter(scene)
    recording = scene.recording if poses == "3d" else keypoints_only(scene.recording)
    if scenario.line_times == "given":
        true = {camera.name: camera.line_time_s for camera in scene.truth.cameras}
        recording = with_known_line_times(recording, true)
    given = Options(
        offset_range_s=scenario.offset_range_s,
        estimate_line_time=scenario.line_times == "estimated",
    )
    outcome = run_calibration(recording, given)
    fps = options.rates(options.n_cameras)[0]
    return judged(outcome, scene.truth, name=scenario.name, seed=options.seed, fps=fps)


def run_calibration(recording: Recording, options: Options | None = None) -> Outcome:
    """Calibrate and measure the CPU time; an error is an outcome, too."""
    start = time.process_time()
    try:
        calibration, refusal = calibrate(recording, options), ""
    except StcalibError as error:
        calibration, refusal = None, str(error)
    return Outcome(calibration, time.process_time() - start, refusal)


def judged(
    outcome: Outcome,
    truth: Calibration,
    *,
    name: str,
    seed: int,
    fps: float,
    bounds: Mapping[str, float] = SUCCESS,
) -> Run:
    """Compare a result with the truth and decide whether the scene is solved."""
    found = outcome.calibration
    if found is None:
        return Run(name, seed, outcome.cpu_s, None, outcome.refusal)
    codes = tuple(dict.fromkeys(rejection.reason.value for rejection in found.reasons))
    try:
        evaluation = evaluate(found, truth, fps=fps)
    except StcalibError as error:
        failure = f"{error} ({found.message})" if found.cameras else found.message
        return Run(name, seed, outcome.cpu_s, None, failure, codes=codes)
    wrong = [] if found.status is Status.OK else [f"{found.status.name}: {found.message}"]
    reasons = {camera.name: camera.reason for camera in found.uncalibrated}
    wrong += [f"{camera}: {reasons.get(camera, 'missing')}" for camera in evaluation.missing]
    values = {error: getattr(evaluation, error) for error in bounds}
    off = [f"{n} {v:.3g}" for n, v in values.items() if not v <= bounds[n]]
    is_wrong = found.status is Status.OK and bool(off)
    return Run(name, seed, outcome.cpu_s, evaluation, ", ".join(wrong + off), is_wrong, codes)


def run_scenes(task: Callable[[int], _T], n: int, *, title: str, jobs: int) -> list[_T]:
    """Run scenes 0 to n - 1, in `jobs` processes, and show the progress on a terminal."""
    if jobs == 1:
        return _followed(map(task, range(n)), n, title)
    with ProcessPoolExecutor(jobs) as pool:
        return _followed(pool.map(task, range(n)), n, title)


def _followed(found: Iterable[_T], n: int, title: str) -> list[_T]:
    out = []
    for one in found:
        out.append(one)
        if sys.stderr.isatty():
            print(f"\r{title}: {len(out)} of {n} ", end="", file=sys.stderr, flush=True)
    if sys.stderr.isatty():
        print("\r", end="", file=sys.stderr)
    return out
