"""The paper's stages for the pipeline: all pairs (PR), one rig (MI), the bundle adjustment."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.geometry.graphs import connected_groups
from stcalib_ros.core.integration.exclusions import Disconnected
from stcalib_ros.core.lifting.views import LiftedViews
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.options import Options
from stcalib_ros.core.paper.merge import merge
from stcalib_ros.core.paper.oriented import oriented_points, spread_windows
from stcalib_ros.core.paper.posegraph import optimise
from stcalib_ros.core.paper.registration import PairRegistration, register
from stcalib_ros.core.paper.stba import adjust_rounds
from stcalib_ros.core.registration.resampling import Grid

Tick = Callable[[str, float], None]
"""Called with the name of the stage and the fraction of it that is done."""


def register_pairs(
    views: LiftedViews, cameras: Sequence[int], options: Options, grid: Grid, tick: Tick
) -> tuple[PairRegistration, ...]:
    """Register all pairs of cameras that can be, on windows spread over the recording."""
    vmf = options.vmf
    rng = np.random.default_rng(options.seed)
    points = {
        c: oriented_points(
            views.lifted[c], views.skeleton, start=grid.start_s, step=grid.step_s, n=grid.n
        )
        for c in cameras
    }
    reach = int(np.ceil(2.0 * options.offset_range_s / grid.step_s)) if vmf.search_offsets else 0
    lags = np.arange(-reach, reach + 1)
    starts = spread_windows(grid.n, vmf.window, vmf.n_windows)
    pairs = [(a, b) for i, a in enumerate(cameras) for b in cameras[i + 1 :]]
    found = []
    for k, (a, b) in enumerate(pairs):
        tick("matching camera pairs", k / len(pairs))
        found.append(register(a, b, points[a], points[b], starts, lags, vmf, rng))
    return tuple(pair for pair in found if pair is not None)


def integrate_pairs(
    group: Sequence[int], pairs: Sequence[PairRegistration], options: Options
) -> Rig:
    """Optimize the pose graph of a group of cameras; the first is its reference."""
    edges = [pair.hypothesis for pair in _within(pairs, group)]
    return optimise(group, edges, synchronised=options.synchronised)


def adjust_pairs(
    cameras: Sequence[LiftedCamera],
    rig: Rig,
    pairs: Sequence[PairRegistration],
    options: Options,
    grid: Grid,
    tick: Tick,
) -> tuple[Iteration, ...] | Disconnected:
    """Merge the associations of the pairs of a rig, and adjust until nothing is rejected."""
    window, members = options.vmf.window, rig.cameras.tolist()
    inside = _within(pairs, members)
    groups = connected_groups(members, [pair.hypothesis for pair in inside])
    if len(groups) > 1:
        return Disconnected(tuple(tuple(members.index(c) for c in group) for group in groups))
    association = merge(
        cameras,
        rig,
        inside,
        start_s=grid.start_s,
        step_s=grid.step_s,
        window=window,
    )
    return adjust_rounds(
        cameras,
        rig,
        association,
        options.bundle,
        step_s=grid.step_s,
        window=window,
        tick=lambda fraction: tick("joint refinement", fraction),
    )


def _within(pairs: Sequence[PairRegistration], group: Sequence[int]) -> list[PairRegistration]:
    return [p for p in pairs if {p.hypothesis.a, p.hypothesis.b} <= set(group)]
