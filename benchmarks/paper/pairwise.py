"""Pairs of cameras on the paper's noise: the noise figure, Table III and the level."""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from benchmarks.paper.baselines import BASELINES, Sampled
from benchmarks.paper.run import Row, Task, row
from benchmarks.paper.scenes import (
    FPS,
    OFFSET_FRAMES,
    REDUCED,
    SCENES,
    SEARCH_FRAMES,
    TWO_D,
    ULTIMATUM,
    PaperScene,
    scene_named,
    seen_by,
    window_starts,
)
from benchmarks.paper.windows import register_on_windows
from stcalib_ros.core.evaluation.stage_errors import Errors, judge_pair
from stcalib_ros.core.lifting.views import LiftedViews, lift_views
from stcalib_ros.core.options import Options, RegistrationOptions, VmfOptions
from stcalib_ros.core.paper.registration import PairRegistration
from stcalib_ros.core.synthetic import Scene, SceneOptions, paper_scene
from stcalib_ros.io.mocap import shipped_clips

T = 5
"""Frames of a window."""
N_WINDOWS = 20
"""Windows of a clip."""
N_FRAMES = 300
"""Frames of a clip."""
STEP = 5
"""The full clip: windows one after the other."""

OURS = ("default", TWO_D)

TABLE_III = ("170915_toddler5", "160422_ultimatum1", "160906_pizza1")
_NAMES = {s.seed: s.name for s in (*SCENES, ULTIMATUM, REDUCED)}

_HIDDEN = {"160422_ultimatum1": 2, "160906_pizza1": 1}
"""Of how many people each camera of these scenes never sees anything: views that do not overlap."""


def noisy_scene(
    name: str, *, sigma_px: float, trial: int, offset_frames: float, n_frames: int = N_FRAMES
) -> Scene:
    """The paper's synthetic observations of one of its scenes."""
    scene = scene_named(name)
    options = SceneOptions(
        n_people=scene.n_people,
        n_frames=n_frames,
        fps=FPS,
        rig=scene.rig,
        rig_scale=scene.rig_scale,
        area_radius_m=scene.area_radius_m,
        sigma_px=sigma_px,
        seed=1000 * trial + scene.seed,
    )
    hidden = _hidden(scene, trial)
    return paper_scene(options, offset_frames=offset_frames, hidden=hidden, clips=scene.clips)


def inside_windows(n: int) -> list[int]:
    """First frames of n windows that have a counterpart at every offset of the search."""
    within = window_starts(N_FRAMES - 2 * SEARCH_FRAMES, T, n)
    return [SEARCH_FRAMES + start for start in within]


def _hidden(scene: PaperScene, trial: int) -> dict[int, list[int]]:
    rng = np.random.default_rng([scene.seed, trial])
    n = _HIDDEN.get(scene.name, 0)
    return {c: rng.permutation(scene.n_people)[:n].tolist() for c in range(4)}


def method_options(
    method: str, *, ransac: bool, n_starts: int = 10, gate_rad: float = VmfOptions().no_match_rad
) -> Options:
    """Options of "correlation" (the default) or "vmf" (the paper's) on windows of T frames."""
    vmf = VmfOptions(
        window=T, n_hypothesised=2 if ransac else 0, n_starts=n_starts, no_match_rad=gate_rad
    )
    return Options(registration=RegistrationOptions(method=method), vmf=vmf)


def noise_tasks(
    name: str, sigmas: Sequence[float], n_observations: int, n_initial: int
) -> list[Task]:
    """The noise figure: sigma 1..5, ten noisy observations, ten random initial rotations each."""
    return [
        Task(f"sigma {sigma:g} observation {k}", noise_rows, (name, sigma, k, n_initial))
        for sigma in sigmas
        for k in range(n_observations)
    ]


def noise_rows(name: str, sigma_px: float, trial: int, n_initial: int) -> list[Row]:
    """All methods on one noisy observation, clocks known; all pairs.

    The paper's matching is applied as written, without leaving out persons: a start that fails then
    gives a wrong rotation, which counts, instead of none, which the means would not include.
    """
    scene = noisy_scene(name, sigma_px=sigma_px, trial=trial, offset_frames=0.0)
    starts = window_starts(N_FRAMES, T, N_WINDOWS)
    single = [starts[trial % N_WINDOWS]]
    rows = []
    for label, windows in (("windows", starts), ("one window", single)):
        for ours in OURS:
            rows += _registered(scene, ours, label, windows, trial, sigma=sigma_px)
        for k in range(n_initial):
            rows += _registered(
                scene,
                "paper",
                label,
                windows,
                trial,
                sigma=sigma_px,
                n_starts=1,
                seed=k,
                gate_rad=np.pi,
            )
        best = "paper, 10 starts"
        rows += _registered(scene, best, label, windows, trial, sigma=sigma_px, gate_rad=np.pi)
        for baseline in BASELINES:
            rows += _baseline(scene, baseline, label, windows, trial, sigma=sigma_px)
    return rows


def table3_tasks(n_trials: int, scenes: Sequence[str] = TABLE_III) -> list[Task]:
    """Table III: sigma 3, offset +5, search +-10, T = 5, with and without RANSAC."""
    return [
        Task(f"{name} trial {k}", table3_rows, (name, k))
        for name in scenes
        for k in range(n_trials)
    ]


def table3_rows(name: str, trial: int) -> list[Row]:
    """Both methods on one scene, all pairs; windows over the clip, and one window alone."""
    scene = noisy_scene(name, sigma_px=3.0, trial=trial, offset_frames=float(OFFSET_FRAMES))
    starts = inside_windows(N_WINDOWS)
    single = [starts[trial % N_WINDOWS]]
    rows = []
    for label, windows in (("windows", starts), ("one window", single)):
        for ours in OURS:
            rows += _registered(scene, ours, label, windows, trial, search=SEARCH_FRAMES)
        for ransac in (False, True):
            method = "paper w/ RANSAC" if ransac else "paper w/o RANSAC"
            rows += _registered(
                scene, method, label, windows, trial, search=SEARCH_FRAMES, ransac=ransac
            )
    return rows


def protocol_tasks(n_scenes: int, n_single: int) -> list[Task]:
    """The level: the paper's protocol with the full clip, and on single windows."""
    return [Task(f"scene {k}", protocol_rows, (k, n_single)) for k in range(n_scenes)]


def protocol_rows(trial: int, n_single: int) -> list[Row]:
    """The default and the paper's method on one pair of a ring of cameras around three people.

    The pair is another one in every scene. Windows are every fifth frame (the full clip), and
    `n_single` windows of five frames by themselves; all of them are inside of what both cameras
    recorded, at any offset of the search.
    """
    options = SceneOptions(n_frames=N_FRAMES, fps=FPS, sigma_px=3.0, seed=5000 + trial)
    scene = paper_scene(options, offset_frames=float(OFFSET_FRAMES), clips=shipped_clips())
    pair = list(combinations(range(4), 2))[trial % 6]
    rows = []
    for method in (*OURS, "paper"):
        rows += _registered(
            scene,
            method,
            "full clip",
            list(range(SEARCH_FRAMES, N_FRAMES - SEARCH_FRAMES - T + 1, STEP)),
            trial,
            search=SEARCH_FRAMES,
            pairs=[pair],
        )
    for start in inside_windows(n_single):
        for method in (*OURS, "paper"):
            rows += _registered(
                scene, method, "one window", [start], trial, search=SEARCH_FRAMES, pairs=[pair]
            )
    return rows


def _registered(
    scene: Scene,
    method: str,
    stage: str,
    starts: Sequence[int],
    trial: int,
    *,
    search: int = 0,
    ransac: bool = False,
    n_starts: int = 10,
    seed: int = 0,
    gate_rad: float = VmfOptions().no_match_rad,
    pairs: Sequence[tuple[int, int]] | None = None,
    sigma: float | None = None,
) -> list[Row]:
    """Rows of the pairs of a scene by the default or the paper's method."""
    name = "correlation" if method in OURS else "vmf"
    options = method_options(name, ransac=ransac, n_starts=n_starts, gate_rad=gate_rad)
    views = lift_views(seen_by(method, scene.recording), options)
    rows = []
    for a, b in pairs or combinations(range(len(views.lifted)), 2):
        began = time.process_time()
        found = register_on_windows(
            views,
            a,
            b,
            starts,
            options,
            max_lag=search,
            rng=np.random.default_rng([seed, trial, a, b]),
        )
        cpu_s = time.process_time() - began
        more = {"pair": f"{a}-{b}", "cpu_s": cpu_s, "sigma_px": sigma, "seed": seed}
        errors = None if found is None else _judged(views, scene, found)
        rows.append(row(_name(scene), method, stage, trial, errors, **more))
    return rows


def _baseline(
    scene: Scene, method: str, stage: str, starts: Sequence[int], trial: int, *, sigma: float
) -> list[Row]:
    options = method_options("vmf", ransac=False)
    views = lift_views(scene.recording, options)
    sampled = Sampled(views, scene.truth, np.array(starts))
    rng = np.random.default_rng([7, trial])
    rows = []
    for a, b in combinations(range(len(views.lifted)), 2):
        began = time.process_time()
        found = BASELINES[method](sampled, a, b, options.vmf, rng)
        more = {"pair": f"{a}-{b}", "cpu_s": time.process_time() - began, "sigma_px": sigma}
        errors = None if found is None else _judged(views, scene, found)
        rows.append(row(_name(scene), method, stage, trial, errors, **more))
    return rows


def _judged(views: LiftedViews, scene: Scene, found: PairRegistration) -> Errors:
    return judge_pair(views.lifted, found, scene.truth, window=T, fps=FPS)


def _name(scene: Scene) -> str:
    return _NAMES.get(scene.options.seed % 1000, "ring of cameras, 3 people")
