"""Pairs of cameras as independent tasks, for whatever executor there is.

A task is picklable and holds what its two cameras saw, not the recording: process pools and
clusters carry it elsewhere, and the answers are the same wherever they were found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.options import Options, RegistrationOptions
from stcalib_ros.core.registration.limits import MIN_SUPPORT_RATIO
from stcalib_ros.core.registration.resampling import Grid, GridTracks, sample_camera
from stcalib_ros.core.registration.two_view_refinement import refine_pair
from stcalib_ros.core.registration.voting import register_pair


@dataclass(frozen=True, slots=True, eq=False)
class PairTask:
    """Two cameras to be registered.

    Attributes
    ----------
    a, b : int
        Indices of the cameras, as the hypotheses carry them.
    cameras : (LiftedCamera, LiftedCamera)
    grids : (GridTracks, GridTracks)
        Resampled tracks of these cameras.
    max_lag : int
        Lags are searched within plus and minus this many samples.
    options : RegistrationOptions
    synchronised : bool
        The clocks are known to agree.
    """

    a: int
    b: int
    cameras: tuple[LiftedCamera, LiftedCamera]
    grids: tuple[GridTracks, GridTracks]
    max_lag: int
    options: RegistrationOptions
    synchronised: bool


def pair_tasks(
    lifted: Sequence[LiftedCamera],
    cameras: Sequence[int],
    skeleton: Skeleton,
    options: Options,
    *,
    grid: Grid,
) -> list[PairTask]:
    """Return the tasks of all pairs of some cameras, sampled on a grid."""
    sampled = {
        c: sample_camera(lifted[c], skeleton, start=grid.start_s, step=grid.step_s, n=grid.n)
        for c in cameras
    }
    max_lag = int(np.ceil(2.0 * options.offset_range_s / grid.step_s))
    return [
        PairTask(
            a,
            b,
            (lifted[a], lifted[b]),
            (sampled[a], sampled[b]),
            max_lag,
            options.registration,
            options.synchronised,
        )
        for i, a in enumerate(cameras)
        for b in cameras[i + 1 :]
    ]


def register(task: PairTask) -> tuple[RelativePose, ...]:
    """Return the hypotheses on a pair: by bone directions, and the refined ones as well."""
    found = register_pair(0, 1, *task.grids, task.max_lag, task.options)
    worth = [h for h in found if h.support >= MIN_SUPPORT_RATIO * found[0].support]
    refined = (
        refine_pair(task.cameras, h, synchronised=task.synchronised)
        for h in worth[: task.options.n_refined]
    )
    hypotheses = (*found, *(h for h in refined if h is not None))
    return tuple(replace(h, a=task.a, b=task.b) for h in hypotheses)
