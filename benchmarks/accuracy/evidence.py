"""Evidence on every solution that the pipeline checks, beside its errors: what limits decide on.

A scene has one solution, or several where cameras are excluded or taken back on the way: each is
an own row of the table, with the cameras that it has.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any
from unittest import mock

import stcalib_ros
from benchmarks.accuracy.measure import run_scenes
from benchmarks.accuracy.scenarios import SUCCESS, Scenario
from benchmarks.paper.multiview import BALANCE
from stcalib_ros.core import pipeline, solution
from stcalib_ros.core.errors import StcalibError
from stcalib_ros.core.evaluation.metrics import evaluate
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.model.rejection import RejectionReason
from stcalib_ros.core.model.rolling_shutter import with_known_line_times
from stcalib_ros.core.options import Options
from stcalib_ros.core.output.assemble import make_calibration
from stcalib_ros.core.output.world_frame import WorldAlignment
from stcalib_ros.core.solution import CalibrationProblem
from stcalib_ros.core.synthetic import simulate
from stcalib_ros.core.validation.camera_checks import CameraChecks
from stcalib_ros.core.validation.verdict import Judgement, Solution
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.convert import convert_npz
from stcalib_ros.io.mocap import shipped_clips
from stcalib_ros.io.results import read_result

REAL_SUCCESS = {"E_R": 0.07, "E_delta": 3.0}
"""rad and frames: what the demo has to reach in `benchmarks.accuracy.level`. Its truth is
accurate to two or three degrees, and its 3D poses hardly show a time offset below four frames."""

_DEMO_FPS = 60.0
_DIGITS = 5
"""Significant digits kept in the table."""


@dataclass(frozen=True, slots=True)
class Row:
    """A solution that was checked.

    Attributes
    ----------
    scene : str
        Kind of the scene, or name of the recording.
    seed : int
    real : bool
        A real recording.
    errors : mapping of str to float
        E_R (rad), E_t, and E_delta (frames) over the cameras of the solution.
    refused_otherwise : bool
        It is refused whatever the limits of the camera checks: another solution fits as well, the
        adjustment has not converged, or the input of a camera is wrong.
    checks : tuple of CameraChecks
        Checks of the cameras of the solution, the reference first, without the last.
    """

    scene: str
    seed: int
    real: bool
    errors: Mapping[str, float]
    refused_otherwise: bool
    checks: tuple[CameraChecks, ...]

    @property
    def good(self) -> bool:
        """Whether no error is above the bounds of a solved scene."""
        bounds = REAL_SUCCESS if self.real else SUCCESS
        return all(self.errors[name] <= bound for name, bound in bounds.items())


@dataclass(frozen=True, slots=True)
class Table:
    """Rows, and what could not be gathered.

    Attributes
    ----------
    rows : tuple of Row
    unsolved : int
        Number of scenes that were refused before any solution was checked.
    absent : tuple of str
        Recordings that are not on this machine.
    """

    rows: tuple[Row, ...]
    unsolved: int = 0
    absent: tuple[str, ...] = ()


def gather(kinds: Sequence[tuple[Scenario, int]], *, jobs: int = 1) -> Table:
    """Calibrate simulated scenes and the real recordings, and keep the evidence.

    Parameters
    ----------
    kinds : sequence of (Scenario, int)
        Kinds of simulated scenes, and the number of scenes of each; a kind that has fewer gives
        all it has.
    jobs : int
        Number of processes.
    """
    found: list[tuple[Row, ...]] = []
    for kind, n_scenes in kinds:
        n = min(n_scenes, kind.n_scenes)
        found += run_scenes(partial(_simulated, kind), n, title=kind.name, jobs=jobs)
    cases = real_cases()
    found += run_scenes(partial(_real, cases), len(cases), title="real", jobs=jobs)
    rows = tuple(row for rows in found for row in rows)
    absent = () if BALANCE.exists() else (BALANCE.name,)
    return Table(rows, sum(not rows for rows in found), absent)


def write_table(path: Path, table: Table) -> None:
    """Write a table as JSON; numbers that JSON does not have as text."""
    said = ("inconsistencies", "remarks")
    names = [field.name for field in fields(CameraChecks) if field.name not in said]
    rows = [
        asdict(row)
        | {"errors": {name: _short(value) for name, value in row.errors.items()}}
        | {"checks": [[_short(getattr(c, n)) for n in names] for c in row.checks]}
        for row in table.rows
    ]
    head = {"unsolved": table.unsolved, "absent": table.absent, "checks": names}
    lines = ",\n".join(json.dumps(row, allow_nan=False) for row in rows)
    path.write_text(f'{json.dumps(head)[:-1]}, "rows": [\n{lines}\n]}}\n')


def read_table(path: Path) -> Table:
    """Read a table that `write_table` wrote."""
    held = json.loads(path.read_text())
    names = held["checks"]
    rows = (
        row
        | {"errors": {name: float(value) for name, value in row["errors"].items()}}
        | {"checks": tuple(_checks(names, values) for values in row["checks"])}
        for row in held["rows"]
    )
    return Table(tuple(Row(**row) for row in rows), held["unsolved"], tuple(held["absent"]))


def _short(value: float) -> float | str:
    if isinstance(value, bool | int):
        return value
    return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else str(value)


def _checks(names: list[str], values: list[float | str]) -> CameraChecks:
    numbers: list[Any] = [float(v) if isinstance(v, str) else v for v in values]
    return CameraChecks(**dict(zip(names, numbers, strict=True)))


def _simulated(scenario: Scenario, index: int) -> tuple[Row, ...]:
    options = scenario.scene_options(index)
    scene = simulate(options, clips=shipped_clips())
    if scenario.alter is not None:
        scene = scenario.alter(scene)
    recording = scene.recording
    if scenario.line_times == "given":
        true = {camera.name: camera.line_time_s for camera in scene.truth.cameras}
        recording = with_known_line_times(recording, true)
    given = Options(
        offset_range_s=scenario.offset_range_s,
        estimate_line_time=scenario.line_times == "estimated",
    )
    fps = options.rates(options.n_cameras)[0]
    task = Task(scenario.name, options.seed, False, scene.truth, fps)
    return rows_of(task, recording, given)


def _real(cases: tuple[tuple[str, tuple[int, ...]], ...], index: int) -> tuple[Row, ...]:
    name, kept = cases[index]
    if name == "demo":
        folder = Path(stcalib_ros.__file__).parent / "data" / "demo"
        recording, truth = (
            read_bag(folder / "balance.mcap"),
            read_result(folder / "balance_truth.yaml"),
        )
    else:
        recording, truth = convert_npz(BALANCE)
    part = replace(recording, cameras=tuple(recording.cameras[c] for c in kept))
    return rows_of(Task(name, index, True, truth, _DEMO_FPS), part, Options())


def real_cases() -> tuple[tuple[str, tuple[int, ...]], ...]:
    """Recordings with all of their four cameras, three, and two of them."""
    names = ["demo", *(["pose2sim_balance"] if BALANCE.exists() else [])]
    kept = [c for n in (4, 3, 2) for c in combinations(range(4), n)]
    return tuple((name, cameras) for name in names for cameras in kept)


@dataclass(frozen=True, slots=True)
class Task:
    """What is known of a recording beside what the pipeline sees.

    Attributes
    ----------
    scene : str
    seed : int
    real : bool
    truth : Calibration
    fps : float
        Frame rate for errors of time offsets.
    """

    scene: str
    seed: int
    real: bool
    truth: Calibration
    fps: float


def rows_of(task: Task, recording: Recording, options: Options) -> tuple[Row, ...]:
    """Calibrate, and compare every solution that is checked with the truth."""
    with _recorded() as solutions:
        try:
            calibration = pipeline.calibrate(recording, options)
        except StcalibError:
            return ()
    has_rival = any(why.reason is RejectionReason.RIVAL_SOLUTION for why in calibration.rejections)
    return tuple(
        Row(
            task.scene,
            task.seed,
            task.real,
            _errors(problem, recording, found, task),
            has_rival or found.unsettled > 0 or any(c.inconsistencies for c in found.checks),
            tuple(replace(checks, inconsistencies=()) for checks in found.checks),
        )
        for problem, found in solutions
    )


@contextmanager
def _recorded() -> Iterator[list[tuple[CalibrationProblem, Solution]]]:
    """Keep every solution that the pipeline checks."""
    found: list[tuple[CalibrationProblem, Solution]] = []
    check_solution = solution.check_solution

    def checked(problem: CalibrationProblem, *args: Any, **kwargs: Any) -> Solution:
        one = check_solution(problem, *args, **kwargs)
        found.append((problem, one))
        return one

    with mock.patch.object(solution, "check_solution", checked):
        yield found


def _errors(
    problem: CalibrationProblem, recording: Recording, found: Solution, task: Task
) -> dict[str, float]:
    calibration = make_calibration(
        recording,
        problem.views.lifted,
        problem.views.skeleton,
        found.last,
        found.covariance,
        WorldAlignment(1.0),
        judgement=Judgement(Status.OK),
        uncalibrated=(),
    )
    errors = evaluate(calibration, task.truth, fps=task.fps)
    return {"E_R": errors.E_R, "E_t": errors.E_t, "E_delta": errors.E_delta}
