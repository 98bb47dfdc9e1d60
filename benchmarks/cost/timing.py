"""One calibration in a process of its own: CPU seconds by stage, peak memory, errors."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from typing import TypeVar

import numpy as np

from benchmarks.accuracy.scenarios import SUCCESS
from stcalib_ros.core.evaluation.metrics import evaluate
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.recording import Recording, Track, keypoints_only
from stcalib_ros.core.options import Options
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.mocap import shipped_clips

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_MB = 1e6
"""Bytes in the unit of memory, MB."""
_FPS = 30.0
"""Frame rate of the simulated scenes, Hz."""
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Timing:
    """Cost of one calibration.

    Attributes
    ----------
    stages : dict of str to float
        CPU seconds of each stage, in their order.
    peak_mb : float
        Peak resident memory of the process, including interpreter and recording, MB.
    solve_mb : float
        The same minus the memory resident before the calibration, MB.
    failure : str
        Reason why the scene is not solved; empty if it is.
    """

    stages: dict[str, float]
    peak_mb: float
    solve_mb: float
    failure: str

    @property
    def cpu_s(self) -> float:
        """CPU seconds of the whole calibration."""
        return sum(self.stages.values())


class StageClock:
    """Progress callback that attributes CPU time to the stages."""

    def __init__(self) -> None:
        self.stages: dict[str, float] = {}
        self._stage, self._since = "", time.process_time()

    def __call__(self, stage: str, _: float = 0.0) -> None:
        """Record that a stage continues or begins."""
        now = time.process_time()
        if self._stage:
            self.stages[self._stage] = self.stages.get(self._stage, 0.0) + now - self._since
        self._stage, self._since = stage, now


def in_own_process(scene: SceneOptions, options: Options, *, without_3d: bool = False) -> Timing:
    """Calibrate a simulated scene in a new process, on one thread.

    Another process simulates the scene, so that its memory does not count.

    Parameters
    ----------
    scene : SceneOptions
    options : Options
    without_3d : bool
        Give the calibration the keypoints only.
    """
    for name in _THREADS:
        os.environ[name] = "1"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.pickle"
        _alone(write_scene, scene, path)
        return _alone(timed, path, options, without_3d)


def _alone(function: Callable[..., _T], *arguments: object) -> _T:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


def write_scene(options: SceneOptions, path: Path) -> None:
    """Simulate a scene and write the recording, as a bag gives it, and the truth to a file."""
    scene = simulate(options, clips=shipped_clips())
    with path.open("wb") as file:
        pickle.dump((as_sent(scene.recording), scene.truth), file, protocol=5)


def as_sent(recording: Recording) -> Recording:
    """The recording with the float32 that messages carry and `read_bag` keeps."""

    def sent(track: Track) -> Track:
        poses = {n: getattr(track, n).astype(np.float32) for n in ("keypoints", "joints", "scores")}
        return replace(track, **poses)

    cameras = (replace(c, tracks=tuple(map(sent, c.tracks))) for c in recording.cameras)
    return replace(recording, cameras=tuple(cameras))


def timed(path: Path, options: Options, without_3d: bool) -> Timing:
    """Calibrate what `write_scene` wrote, in this process."""
    with path.open("rb") as file:
        recording, truth = pickle.load(file)
    if without_3d:
        recording = keypoints_only(recording)
    before = resident_mb("VmRSS")
    clock = StageClock()
    found = run_stages(recording, options, progress=clock).calibration
    clock("")
    peak = resident_mb("VmHWM")
    return Timing(clock.stages, peak, peak - before, _failure(found, truth))


def resident_mb(field: str) -> float:
    """Resident memory of this process by a field of ``/proc/self/status``, MB; NaN elsewhere.

    Not `resource.getrusage`, whose peak a process inherits from the one that started it.
    """
    status = Path("/proc/self/status")
    for line in status.read_text().splitlines() if status.exists() else ():
        if line.startswith(f"{field}:"):
            return int(line.split()[1]) * 1024 / _MB
    return float("nan")


def _failure(found: Calibration, truth: Calibration) -> str:
    if found.status is not Status.OK:
        return f"{found.status.name}: {found.message}"
    errors = evaluate(found, truth, fps=_FPS)
    wrong = [f"{name} is missing" for name in errors.missing]
    wrong += [
        f"{n} {getattr(errors, n):.3g}" for n, most in SUCCESS.items() if getattr(errors, n) > most
    ]
    return ", ".join(wrong)


def startup_cpu_s(*, repeats: int = 5) -> float:
    """CPU seconds of ``stcalib calibrate --help``, children of this process; the median."""
    command = [sys.executable, "-m", "stcalib_ros", "calibrate", "--help"]
    return median(_child_cpu_s(command) for _ in range(repeats))


def _child_cpu_s(command: Sequence[str]) -> float:
    before = os.times()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    after = os.times()
    user, system = after.children_user - before.children_user, after.children_system
    return user + system - before.children_system
