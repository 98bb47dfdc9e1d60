"""Iterated STBA (ISTBA): associate, adjust, drop what does not fit, again (Section IV)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from stcalib_ros.core.bundle.gauge import spread
from stcalib_ros.core.bundle.iteration import Iteration, _rig_of
from stcalib_ros.core.bundle.levenberg_marquardt import adjust
from stcalib_ros.core.bundle.limits import (
    CONVERGED_FRAMES,
    CONVERGED_POSE,
    ENOUGH_SLOTS,
    FINAL_TOLERANCE,
    FIRST_FLOOR_PX,
    FIRST_TOLERANCE,
    FLOOR_PX,
    MAX_POINTS_BETWEEN,
    MAX_POINTS_FIRST,
    MIN_ITERATIONS,
    MIN_JOINTS,
    TOLERANCE,
)
from stcalib_ros.core.bundle.observations import Observations, observe
from stcalib_ros.core.bundle.offset_debiasing import debias_offsets
from stcalib_ros.core.bundle.outliers import connected, drop_outliers, image_points
from stcalib_ros.core.bundle.parameters import ParameterLayout
from stcalib_ros.core.bundle.residuals import errors_px, median_error
from stcalib_ros.core.bundle.state import BundleState, estimate_motion, initial_state
from stcalib_ros.core.integration.association import SLOT_SAMPLES, Association, associate
from stcalib_ros.core.integration.exclusions import Disconnected
from stcalib_ros.core.lifting.relens import at_rig
from stcalib_ros.core.model.arrays import IntArray
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.options import BundleOptions


def initial_adjustment(
    cameras: Sequence[LiftedCamera], rig: Rig, options: BundleOptions, *, step_s: float
) -> Iteration | Disconnected:
    """Associate at the rig of the multi-view integration and adjust on a part of the joints."""
    cameras = at_rig(cameras, rig)
    every = _every_slot(cameras, rig, step_s)
    association = associate(cameras, rig, step_s=step_s, floor_px=FIRST_FLOOR_PX, every=every)
    return _round(
        *(cameras, rig, association, options, step_s),
        tolerance=FIRST_TOLERANCE,
        every_slot=every,
        max_points=MAX_POINTS_FIRST,
    )


def istba_iteration(
    cameras: Sequence[LiftedCamera],
    before: Iteration,
    options: BundleOptions,
    *,
    step_s: float,
    last: bool,
) -> Iteration | Disconnected:
    """Associate again, adjust without the outliers; on a part of everything until the last."""
    rig = before.rig
    cameras = at_rig(cameras, rig)
    every = 1 if last else _every_slot(cameras, rig, step_s)
    association = associate(cameras, rig, step_s=step_s, floor_px=FLOOR_PX, every=every)
    tolerance = FINAL_TOLERANCE if last else TOLERANCE
    return _round(
        *(cameras, rig, association, options, step_s),
        tolerance=tolerance,
        every_slot=every,
        max_points=None if last else MAX_POINTS_BETWEEN,
        drop=True,
        last=last,
    )


def _every_slot(cameras: Sequence[LiftedCamera], rig: Rig, step_s: float) -> int:
    """Step between the slots that are enough to begin with: 600 samples and more."""
    longest = max(float(cameras[c].stamps[-1] - cameras[c].stamps[0]) for c in rig.cameras)
    return max(1, int(longest / (SLOT_SAMPLES * step_s)) // ENOUGH_SLOTS)


def run_istba(
    cameras: Sequence[LiftedCamera],
    first: Iteration,
    options: BundleOptions,
    *,
    step_s: float,
    tick: Callable[[float, Iteration], None],
) -> tuple[Iteration, ...] | Disconnected:
    """Rounds until neither persons nor cameras change; the last one is solved to the end.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
    first : Iteration
    options : BundleOptions
    step_s : float
    tick : callable
        Called before each round with the fraction done and the round before.

    Returns
    -------
    tuple of Iteration or Disconnected
        The first round and the last two; those between would only take memory. The latter as soon
        as cameras are no longer connected.
    """
    done = [first]
    # The initial adjustment has a part of the joints only: one iteration follows in any case.
    n_iterations = max(options.rounds, 2)
    for n in range(1, n_iterations):
        tick(n / n_iterations, done[-1])
        converged = n >= MIN_ITERATIONS and _converged(done[-2], done[-1], step_s)
        last = converged or n == n_iterations - 1
        result = istba_iteration(cameras, done[-1], options, step_s=step_s, last=last)
        if isinstance(result, Disconnected):
            return result
        done = [first, *done[1:][-1:], result]
        if last:
            break
    return tuple(done)


def _converged(before: Iteration, after: Iteration, step_s: float) -> bool:
    same = all(
        np.array_equal(a, b)
        for a, b in zip(before.association.person_of, after.association.person_of, strict=True)
    )
    length = spread(after.rig.t_ref_cam)
    moved = np.linalg.norm(after.rig.t_ref_cam - before.rig.t_ref_cam, axis=-1).max() / length
    turned = np.abs(after.rig.R_ref_cam - before.rig.R_ref_cam).max()
    shifted = np.abs(after.rig.offset_s - before.rig.offset_s).max() / step_s
    return same and bool(max(moved, turned) < CONVERGED_POSE and shifted < CONVERGED_FRAMES)


def _round(
    cameras: Sequence[LiftedCamera],
    rig: Rig,
    association: Association,
    options: BundleOptions,
    step_s: float,
    *,
    tolerance: float,
    every_slot: int,
    max_points: int | None = None,
    drop: bool = False,
    last: bool = False,
) -> Iteration | Disconnected:
    observations = observe(cameras, rig, association, step_s=step_s)
    J = observations.x.shape[2]
    every = 1
    if max_points is not None:
        every = min(-(-len(observations.person) * J // max_points), J // MIN_JOINTS) or 1
        observations = observations.thinned_joints(every)
    state = initial_state(observations, rig)
    if drop:
        state = drop_outliers(observations, state, options)
    total = image_points([cameras[c] for c in rig.cameras]) // (every * every_slot)
    groups = connected(state.inlier, total)
    if len(groups) > 1:
        return Disconnected(tuple(groups))
    state = adjust(
        observations,
        state,
        iterations=options.max_iterations,
        tolerance=tolerance,
        renew_velocities=last,
    )
    if drop:
        state = debias_offsets(observations, state, iterations=options.max_iterations)
    if last:
        state = drop_outliers(observations, state, options)
    coverage = every_slot * J / observations.x.shape[2]
    return finish_iteration(rig, association, observations, state, total, coverage=coverage)


def finish_iteration(
    rig: Rig,
    association: Association,
    observations: Observations,
    state: BundleState,
    total: IntArray,
    *,
    coverage: float = 1.0,
) -> Iteration:
    """The record of a round that started from a rig; `total` image points (C,) in all."""
    errors = errors_px(observations, state)
    median = median_error(errors, state.inlier)
    explained = float((state.inlier.sum((0, 2)) / np.maximum(total, 1)).min())
    return Iteration(
        _rig_of(state, rig), association, observations, state, median, coverage, explained
    )


def readjusted(
    before: Iteration,
    observations: Observations,
    options: BundleOptions,
    *,
    last: bool,
    layout: ParameterLayout | None = None,
) -> Iteration:
    """Adjust a round from where it is to images at other times, or to further unknowns."""
    known = before.state.triangulated()
    V, A = estimate_motion(observations, before.state.X, known)
    state = drop_outliers(observations, replace(before.state, V=V, A=A), options)
    tolerance = FINAL_TOLERANCE if last else TOLERANCE
    state = adjust(
        observations, state, iterations=options.max_iterations, tolerance=tolerance, layout=layout
    )
    return before.with_state(observations, state)
