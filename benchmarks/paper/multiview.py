"""All cameras of the scenes of Table II: Tables I and II, and the real recording."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.paper.baselines import BASELINES, baseline_stages
from benchmarks.paper.run import Row, Task, row
from benchmarks.paper.scenes import (
    DATA,
    FPS,
    OFFSET_FRAMES,
    SCENES,
    SEARCH_FRAMES,
    TWO_D,
    late,
    lifted_scene,
    scene_named,
    seen_by,
)
from benchmarks.paper.sfm import SfmFailure
from benchmarks.paper.vo import calibrate_vo
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.evaluation.stage_errors import judge_stages
from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.options import Options, RegistrationOptions, VmfOptions
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.io.convert import convert_npz
from stcalib_ros.io.convert_options import ConvertOptions

TABLE_I = ("160906_pizza1", "soccer1_6", "industry_safety_2")
TABLE_II = tuple(scene.name for scene in SCENES)
SEARCH_S = SEARCH_FRAMES / FPS
_REGISTRATION = {"default": "correlation", TWO_D: "correlation", "paper": "vmf"}
"""Registration of our methods; all others are baselines."""

BALANCE = DATA / "pose2sim_balance" / "balance_multi_blazepose.npz"
BALANCE_SHIFTS_S = {"cam02": 0.317, "cam03": -0.21, "cam04": 0.143}
_BALANCE_RANGE_S = 1.0
"""Two of the clocks differ by more than half a second."""
_BALANCE_FPS = 60.0
"""Frame rate of the real recording, Hz."""


def options_of(method: str, T: int, *, range_s: float, search_offsets: bool = True) -> Options:
    """Options of "correlation" (the default) or "vmf" (the paper's method)."""
    return Options(
        offset_range_s=range_s,
        registration=RegistrationOptions(method=method),
        vmf=VmfOptions(window=T, search_offsets=search_offsets),
    )


def table1_tasks(n_trials: int, scenes: Sequence[str] = TABLE_I) -> list[Task]:
    """Table I: synchronised clips, every method, rows PR, MI, BA, IBA."""
    return _tasks(table1_rows, scenes, (*_REGISTRATION, *BASELINES), n_trials)


def table1_rows(name: str, method: str, trial: int) -> list[Row]:
    """One method on one scene."""
    scene = scene_named(name)
    made = lifted_scene(scene, trial=trial)
    if method in BASELINES:
        return _baseline_rows(name, method, trial, made.recording, made.truth, scene.T)
    options = replace(options_of(_REGISTRATION[method], scene.T, range_s=0.0), seed=trial)
    recording = seen_by(method, made.recording)
    return stage_rows(name, method, trial, recording, made.truth, options, fps=FPS)


def table2_tasks(n_trials: int, scenes: Sequence[str] = TABLE_II) -> list[Task]:
    """Table II: clocks late by five frames, every scene, rows STBA and ISTBA."""
    methods = (*_REGISTRATION, "paper, offsets by STBA alone", "Vo et al.")
    return _tasks(table2_rows, scenes, methods, n_trials)


def _tasks(
    rows: Callable[[str, str, int], list[Row]],
    scenes: Sequence[str],
    methods: Sequence[str],
    n_trials: int,
) -> list[Task]:
    return [
        Task(f"{name} {method} trial {k}", rows, (name, method, k))
        for name in scenes
        for method in methods
        for k in range(n_trials)
    ]


def table2_rows(name: str, method: str, trial: int) -> list[Row]:
    """One method on one scene."""
    scene = scene_named(name)
    made = lifted_scene(scene, trial=trial)
    recording, truth = late(made.recording, made.truth, OFFSET_FRAMES)
    if method == "Vo et al.":
        began = time.process_time()
        try:
            found = calibrate_vo(
                np.random.default_rng([scene.seed, trial]), recording, truth, made.rig
            )
        except SfmFailure as failure:
            cpu_s = time.process_time() - began
            return [row(name, method, "STBA", trial, None, cpu_s=cpu_s, failure=str(failure))]
        figures = rig_errors(found.rig.R_ref_cam, found.rig.t_ref_cam, found.rig.offset_s, truth)
        more = figures | {"E_2D": found.mean_px, "E_2D_rms": found.rms_px}
        cpu_s = time.process_time() - began
        return [row(name, method, "STBA", trial, None, cpu_s=cpu_s, **more)]
    options = options_of(
        _REGISTRATION.get(method, "vmf"),
        scene.T,
        range_s=SEARCH_S,
        search_offsets=method != "paper, offsets by STBA alone",
    )
    options = replace(options, seed=trial)
    recording = seen_by(method, recording)
    return stage_rows(name, method, trial, recording, truth, options, fps=FPS)


def rig_errors(
    R_ref_cam: Float64Array, t_ref_cam: Float64Array, offset_s: Float64Array, truth: Calibration
) -> dict[str, float]:
    """E_R, E_t and E_delta of cameras in the order of the truth, the first the reference."""
    R = np.stack([c.R_ref_cam for c in truth.cameras])
    t = np.stack([c.t_ref_cam for c in truth.cameras])
    true_s = np.array([c.time_offset_s for c in truth.cameras])
    baseline = float(np.linalg.norm(t[1]))
    ours = t_ref_cam * baseline / np.linalg.norm(t_ref_cam[1])
    error = np.linalg.norm(ours - t, axis=-1)[1:] / baseline
    return {
        "E_R": float(rotation_angle(np.swapaxes(R, -1, -2) @ R_ref_cam)[1:].mean()),
        "E_t": float(np.sqrt(np.mean(error**2))),
        "E_delta": float(np.abs(offset_s - true_s)[1:].mean()) * FPS,
    }


def stage_rows(
    scene: str,
    method: str,
    trial: int,
    recording: Recording,
    truth: Calibration,
    options: Options,
    *,
    fps: float,
) -> list[Row]:
    """Every stage of a calibration against the truth; the CPU time is that of all stages."""
    began = time.process_time()
    stages = run_stages(recording, options)
    cpu_s = time.process_time() - began
    judged = judge_stages(stages, truth, fps=fps, synchronised=options.synchronised)
    status = stages.calibration.status.name
    rows = [
        row(scene, method, stage, trial, errors, cpu_s=cpu_s, status=status)
        for stage, errors in judged.items()
    ]
    if not stages.iterations:
        last = "IBA" if options.synchronised else "ISTBA"
        message = stages.calibration.message
        rows.append(row(scene, method, last, trial, None, cpu_s=cpu_s, failure=message))
    return rows


def _baseline_rows(
    scene: str, method: str, trial: int, recording: Recording, truth: Calibration, T: int
) -> list[Row]:
    began = time.process_time()
    options = options_of("vmf", T, range_s=0.0)
    stages = baseline_stages(method, recording, truth, options, seed=trial)
    cpu_s = time.process_time() - began
    if not stages.iterations:
        return [row(scene, method, "IBA", trial, None, cpu_s=cpu_s, failure="nothing to adjust")]
    before, *after = stages.iterations
    rows = []
    for rounds, names in ((before,), ("PR", "MI")), (tuple(after), ("BA", "IBA")):
        if not rounds:
            rows.append(row(scene, method, "IBA", trial, None, cpu_s=cpu_s, failure="disconnected"))
            continue
        judged = judge_stages(replace(stages, iterations=rounds), truth, fps=FPS, synchronised=True)
        rows += [row(scene, method, n, trial, judged[n], cpu_s=cpu_s) for n in names]
    return rows


def real_tasks() -> list[Task]:
    """The real recordings of the data folder, those that are there."""
    tasks = []
    if BALANCE.is_file():
        methods = (*_REGISTRATION, *BASELINES)
        tasks += [Task(f"balance {m}", balance_rows, (m,)) for m in methods]
    return tasks


def balance_rows(method: str) -> list[Row]:
    """Two people before four cameras, BlazePose, clocks shifted by fractions of a second.

    The baselines cannot find offsets: they are given the synchronised clip.
    """
    name = "pose2sim_balance"
    path = Path(BALANCE)
    if method in BASELINES:
        made = convert_npz(path)
        return _baseline_rows(name, method, 0, made.recording, made.truth, 15)
    made = convert_npz(path, ConvertOptions(BALANCE_SHIFTS_S))
    options = options_of(_REGISTRATION[method], 15, range_s=_BALANCE_RANGE_S)
    recording = seen_by(method, made.recording)
    try:
        return stage_rows(name, method, 0, recording, made.truth, options, fps=_BALANCE_FPS)
    except InputError as error:
        return [row(name, method, "ISTBA", 0, None, failure=str(error))]
