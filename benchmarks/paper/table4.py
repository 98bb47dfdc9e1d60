"""Table IV and the times: checkerboards against people, and the cost of each method.

The adjustment (BA) after boards treats their corners as free points, for all three.
"""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import combinations

import numpy as np

from benchmarks.paper.boards import show_boards
from benchmarks.paper.classical import eight_point, pnp
from benchmarks.paper.multiview import SEARCH_S, options_of, rig_errors, stage_rows, table1_rows
from benchmarks.paper.point_bundle import PointBundle, adjusted, triangulated
from benchmarks.paper.run import Row, Task, row
from benchmarks.paper.scenes import (
    FPS,
    OFFSET_FRAMES,
    TWO_D,
    late,
    lifted_scene,
    scene_named,
    seen_by,
)
from benchmarks.paper.sfm import SfmFailure, incremental_sfm
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.paper.posegraph import optimise

SCENE = "soccer1_6"
N_RINGS = 3
"""Cameras of the trials of Table I, in turn."""


def table4_tasks(n_trials: int, n_people: int) -> list[Task]:
    """Trials with boards, and with people instead."""
    boards = [Task(f"boards trial {k}", board_rows, (k,)) for k in range(n_trials)]
    return (
        boards
        + [
            Task(f"people {method} trial {k}", table1_rows, (SCENE, method, k))
            for method in ("default", TWO_D, "paper")
            for k in range(n_people)
        ]
        + [Task(f"people without bias trial {k}", unbiased_rows, (k,)) for k in range(n_people)]
    )


def unbiased_rows(trial: int) -> list[Row]:
    """The default with unbiased keypoints, as the corners of the boards do."""
    scene = scene_named(SCENE)
    made = lifted_scene(scene, trial=trial, bias_mm=0.0)
    options = options_of("correlation", scene.T, range_s=0.0)
    method = "default, keypoints without bias"
    return stage_rows(SCENE, method, trial, made.recording, made.truth, options, fps=FPS)


def board_rows(trial: int) -> list[Row]:
    """Ten boards before each pair; 8-pts, PnP and SfM, each integrated (MI) and adjusted (BA).

    The pairwise methods use a board in the two cameras it was held up for; SfM uses it wherever
    it is seen, as it registers cameras by points that two others know. Without the size of the
    squares the eight-point algorithm knows no lengths: every pair then has a translation of 1.
    """
    made = lifted_scene(scene_named(SCENE), trial=trial % N_RINGS, n_frames=2)
    world, truth = made.rig, made.truth
    shots = show_boards(np.random.default_rng([4, trial]), world)
    cameras = list(range(len(world.names)))
    rows: list[Row] = []
    every = list(combinations(cameras, 2))
    by_eight_points = [eight_point(shots, a, b) for a, b in every]
    unit = [replace(h, t_a_b=h.t_a_b / np.linalg.norm(h.t_a_b)) for h in by_eight_points]
    registered = {
        "8-pts": by_eight_points,
        "8-pts, lengths unknown": unit,
        "PnP": [pnp(shots, world, a, b) for a, b in every],
    }
    for method, pairs in registered.items():
        rig = optimise(cameras, pairs, synchronised=True)
        views = shots.of_pairs_only()
        rows.append(_row(method, "MI", trial, triangulated(views, rig), truth))
        rows.append(_row(method, "BA", trial, adjusted(views, rig), truth))
    try:
        found = incremental_sfm(shots.views)
    except SfmFailure as failure:
        return [*rows, row(SCENE, "Inc. SfM", "BA", trial, None, failure=str(failure))]
    rows.append(_row("Inc. SfM", "MI", trial, found, truth))
    rows.append(_row("Inc. SfM", "BA", trial, adjusted(shots.views, found.rig), truth))
    return rows


def _row(method: str, stage: str, trial: int, bundle: PointBundle, truth: Calibration) -> Row:
    rig: Rig = bundle.rig
    errors = rig_errors(rig.R_ref_cam, rig.t_ref_cam, rig.offset_s, truth)
    figures = errors | {"E_2D": bundle.mean_px, "E_2D_rms": bundle.rms_px}
    return row(SCENE, method, stage, trial, None, **figures)


def timing_tasks(n_repeats: int) -> list[Task]:
    """CPU time of a whole calibration, with and without temporal alignment."""
    return [
        Task(f"{method} {aligned} repeat {k}", timing_rows, (method, aligned, k))
        for aligned in ("with", "without")
        for method in ("default", TWO_D, "paper")
        for k in range(n_repeats)
    ]


def timing_rows(method: str, aligned: str, repeat: int) -> list[Row]:
    """One calibration of the scene whose time the paper gives; CPU seconds of one core."""
    scene = scene_named("170915_toddler5")
    made = lifted_scene(scene, trial=repeat)
    recording, truth = made.recording, made.truth
    range_s = 0.0
    if aligned == "with":
        recording, truth = late(recording, truth, OFFSET_FRAMES)
        range_s = SEARCH_S
    options = options_of("vmf" if method == "paper" else "correlation", scene.T, range_s=range_s)
    recording = seen_by(method, recording)
    began = time.process_time()
    rows = stage_rows(scene.name, method, repeat, recording, truth, options, fps=FPS)
    judged = time.process_time() - began
    last = rows[-1]
    return [dict(last) | {"stage": f"{aligned} temporal alignment", "judged_cpu_s": judged}]
