"""The paper's spatiotemporal bundle adjustment and outlier removal (STBA, ISTBA; Section IV).

Solver and robust cost are those of `stcalib_ros.core.bundle.levenberg_marquardt`; what differs is
the motion model, ``X^c = X + delta^c V`` with one V of each joint for a window of T frames, and
that images stay in the time bins that they are assigned to at first, however far the offsets move.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from stcalib_ros.core.bundle.istba import finish_iteration
from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.levenberg_marquardt import adjust
from stcalib_ros.core.bundle.observations import Observations, observe
from stcalib_ros.core.bundle.outliers import connected, drop_outliers, image_points
from stcalib_ros.core.bundle.residuals import errors_px
from stcalib_ros.core.bundle.state import BundleState
from stcalib_ros.core.bundle.state import initial_state as bundle_initial_state
from stcalib_ros.core.integration.association import Association
from stcalib_ros.core.integration.exclusions import Disconnected
from stcalib_ros.core.model.arrays import BoolArray, Float32Array, Float64Array, IntArray
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.options import BundleOptions

_TOLERANCE = 0.05
"""Standard deviations. Steps below it end an adjustment; smaller than in the default method, whose
iterations continue each other, since the paper compares converged stages."""
_MIN_SPREAD_S2 = 1e-12
"""Sum of squared times (s^2) in a window; keeps a joint of one frame from dividing by zero."""


def adjust_rounds(
    cameras: Sequence[LiftedCamera],
    rig: Rig,
    association: Association,
    options: BundleOptions,
    *,
    step_s: float,
    window: int,
    tick: Callable[[float], None],
) -> tuple[Iteration, ...] | Disconnected:
    """STBA, then outlier removal and STBA again until nothing more is removed (ISTBA).

    With synchronised cameras it is BA and IBA.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
    rig : Rig
        Rig of the pose graph.
    association : Association
        Association along the spanning tree.
    options : BundleOptions
        Options; its minimum for outliers is ignored, as the paper's limit is a multiple of the
        median alone.
    step_s : float
    window : int
        Number of frames over which a joint has one velocity.
    tick : callable
        Called with the fraction done before each iteration.

    Returns
    -------
    tuple of Iteration or Disconnected
        The first is STBA, the last ISTBA.
    """
    options = replace(options, outlier_floor_px=0.0)
    observations = observe(cameras, rig, association, step_s=step_s)
    total = image_points([cameras[c] for c in rig.cameras])
    state = initial_state(observations, rig, window)
    rounds: list[Iteration] = []
    while len(rounds) < max(options.rounds, 2):
        tick(len(rounds) / options.rounds)
        if len(groups := connected(state.inlier, total)) > 1:
            return Disconnected(tuple(groups))
        state = adjust(observations, state, iterations=options.max_iterations, tolerance=_TOLERANCE)
        rounds.append(finish_iteration(rig, association, observations, state, total))
        before = state.inlier
        association, observations = discard(rounds[-1], options.outlier_factor)
        state = drop_outliers(observations, state, options)
        if len(rounds) > 1 and np.array_equal(before, state.inlier):
            break
    return tuple(rounds)


def initial_state(obs: Observations, rig: Rig, window: int) -> BundleState:
    """Triangulate joints, with one velocity per window and no acceleration."""
    state = bundle_initial_state(obs, rig)
    V = window_velocities(obs, state.X, state.triangulated(), window)
    return replace(state, V=V, A=np.zeros_like(V))


def window_velocities(
    obs: Observations, X: Float64Array, present: BoolArray, window: int
) -> Float64Array:
    """Fit the velocity (N, J, 3), per second, of each joint in its window by least squares.

    Parameters
    ----------
    obs : Observations
        Observations whose time bins are divided into windows, person by person.
    X : (N, J, 3) ndarray
    present : (N, J) ndarray of bool
        Where X is known.
    window : int
        Number of time bins of a window.
    """
    group = np.stack([obs.person, obs.time_bin // window], -1)
    first = np.flatnonzero(np.any(np.diff(group, axis=0, prepend=-1) != 0, axis=-1))
    rows = np.repeat(np.arange(len(first)), np.diff([*first, len(group)]))
    m = present[..., None].astype(float)
    n = np.maximum(np.add.reduceat(m, first), 1.0)
    t = obs.step_s * obs.time_bin[:, None, None].astype(float)
    t = m * (t - (np.add.reduceat(m * t, first) / n)[rows])
    known = np.where(m > 0, X, 0.0)
    spread = np.add.reduceat(t**2, first)
    slope = np.add.reduceat(t * known, first) / np.maximum(spread, _MIN_SPREAD_S2)
    return np.asarray(np.where(spread > 0, slope, 0.0)[rows])


def discard(done: Iteration, factor: float) -> tuple[Association, Observations]:
    """Verify the association: remove the tracks of persons that do not fit.

    A camera's part in a person is discarded, slot by slot, where its mean reprojection error is
    above `factor` times the median of all.
    """
    obs, association = done.observations, done.association
    errors = errors_px(obs, done.state)
    limit = factor * done.median_px
    slot = association.slot(obs.start_s + obs.step_s * obs.time_bin.astype(np.float64))
    n_slots = association.person_of[0].shape[1]
    unit = obs.person * n_slots + slot
    bad = _mean_by(unit, errors, association.n_persons * n_slots) > limit
    seen = obs.observed & ~bad[unit][..., None]
    person_of = tuple(
        _without(persons, bad[:, c].reshape(-1, n_slots))
        for c, persons in enumerate(association.person_of)
    )
    verified = replace(association, person_of=person_of, typical_px=done.median_px)
    return verified, replace(obs, observed=seen)


def _mean_by(unit: IntArray, errors: Float32Array, n_units: int) -> Float64Array:
    """Average errors (N, C, J) over the rows of each unit (units, C); 0 where there are none."""
    known = np.isfinite(errors)
    total, count = np.zeros((2, n_units, errors.shape[1]))
    np.add.at(total, unit, np.where(known, errors, 0.0).sum(-1))
    np.add.at(count, unit, known.sum(-1))
    return np.asarray(total / np.maximum(count, 1.0))


def _without(persons: IntArray, bad: BoolArray) -> IntArray:
    """Return the persons (P, S) of one camera, -1 where (person, slot) is bad."""
    if not len(bad):
        return persons
    out = (persons >= 0) & bad[persons, np.arange(persons.shape[1])]
    return np.where(out, -1, persons)
