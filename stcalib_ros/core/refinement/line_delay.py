"""Line times of rolling shutters: people who move lean where rows are taken one after the other.

A line time acts like a clock offset, times the row of each image point. Where people move in front
of cameras that see them in different rows, the line times follow from the same residuals as the
offsets; those that the recording does not tell stay what they are given as.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.covariance import clusters, to_reference
from stcalib_ros.core.bundle.istba import readjusted
from stcalib_ros.core.bundle.iteration import Iteration, LineDelays
from stcalib_ros.core.bundle.levenberg_marquardt import gauge
from stcalib_ros.core.bundle.normal_equations import CAMERA, Block, Cameras
from stcalib_ros.core.bundle.observations import row_blocks
from stcalib_ros.core.bundle.residuals import errors_px, robust_scale
from stcalib_ros.core.bundle.state import BundleState
from stcalib_ros.core.geometry.robust import CAUCHY, MIN_SCALE_PX
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rolling_shutter import MAX_READOUT_STDDEV_S
from stcalib_ros.core.options import BundleOptions
from stcalib_ros.core.refinement.keypoint_bias.stage import Refined, refine_keypoint_bias

_TURNS = 2
_SAME = 0.5
_PASSES = 8
_SETTLED = 0.1
"""Done when no line time moves by more than this share of its deviation."""


@dataclass(frozen=True, slots=True, eq=False)
class _Normal:
    """Normal equations (8 C, 8 C) of cameras and line times, and scores (8 C, n) of clusters."""

    H: Float64Array
    scores: Float64Array
    state: BundleState

    def stddev(self, free: BoolArray) -> Float64Array:
        """Deviations (C,) of the line times, those of the free ones estimated together."""
        _, P = self.solved(free)
        return np.sqrt(np.diag(P)[CAMERA * len(free) :])

    def told(self, most: Float64Array) -> BoolArray:
        """Cameras (C,) whose line times can be estimated to within `most` (C,).

        What all of them have in common is known less than how they differ: to take one as known
        that is not would tell the others wrongly. All that do not fail by themselves are told,
        or none.
        """
        C = len(most)
        alone = np.array([self.stddev(one)[c] for c, one in enumerate(np.eye(C, dtype=bool))])
        able = alone <= most
        return able & bool((self.stddev(able) <= most).all())

    def solved(self, free: BoolArray) -> tuple[Float64Array, Float64Array]:
        """Steps (8 C,) to the optimum, and their covariance (8 C, 8 C) by the scatter of clusters.

        Parameters
        ----------
        free : (C,) ndarray of bool
            Cameras whose line times are unknown.
        """
        k, size = CAMERA * len(free), len(self.H)
        poses, scale = gauge(self.state.t_cam_ref, synchronised=self.state.synchronised)
        index = np.concatenate([poses, k + np.flatnonzero(free)])
        H = self.H.copy()
        H[:k, :k] += 1e6 * np.diag(H)[:k].max() * np.outer(scale, scale)
        unit = np.sqrt(np.maximum(np.diag(H)[index], 1e-30))
        inverse = np.linalg.pinv(
            H[np.ix_(index, index)] / np.outer(unit, unit), rcond=1e-13, hermitian=True
        )
        inverse /= np.outer(unit, unit)
        U = self.scores[index]
        step, P = np.zeros(size), np.zeros((size, size))
        step[index] = -inverse @ U.sum(1)
        n = U.shape[1]
        P[np.ix_(index, index)] = inverse @ (U @ U.T) @ inverse * n / max(n - len(index), 1)
        return step, P


def refine_with_line_delays(
    cameras: Sequence[LiftedCamera], last: Iteration, layout: Layout, o: BundleOptions
) -> tuple[Iteration, Refined | None]:
    """Adjust a round to its line times, and to the biases of its key points, in turn.

    Either explains a part of the other: each is found anew with what the other has come to.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        With the rows of their key points.
    last : Iteration
    layout : Layout
    o : BundleOptions

    Returns
    -------
    Iteration
        With line times only.
    Refined or None
        With both; None where biases explain nothing.
    """
    plain = with_line_delays(cameras, last, o)
    refined = None
    for turn in range(_TURNS):
        refined = refine_keypoint_bias(cameras, plain, layout, o)
        if refined is None:
            break
        both = with_line_delays(cameras, refined.round, o)
        refined = replace(refined, round=both)
        moved = np.abs(_lines(both) - _lines(plain))
        if turn == _TURNS - 1 or (moved <= _SAME * _deviations(both)).all():
            break
        plain = replace(_adjusted(plain, _lines(both), o, last=True), lines=both.lines)
    return plain, refined


def with_line_delays(
    cameras: Sequence[LiftedCamera], last: Iteration, o: BundleOptions
) -> Iteration:
    """A round with the line times of its cameras, adjusted to them where the recording tells them.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        With the rows of their key points.
    last : Iteration
    o : BundleOptions
    """
    members = [cameras[c] for c in last.rig.cameras]
    given = np.array([m.shutter.line_time_s for m in members])
    most = MAX_READOUT_STDDEV_S / np.array([m.shutter.height for m in members])
    timed, told = last, np.ones(len(members), dtype=bool)
    for n in range(_PASSES):
        normal = _normal(timed, timed.state)
        told = normal.told(most)
        step, P = normal.solved(told)
        line = np.where(told, _lines(timed) + step[CAMERA * len(members) :], given)
        moved = np.abs(line - _lines(timed))
        if not moved.any():
            break
        settled = bool((moved <= _SETTLED * np.sqrt(np.diag(P))[CAMERA * len(members) :]).all())
        timed = _adjusted(timed, line, o, last=settled or n == _PASSES - 1)
        if settled:
            break
    return replace(timed, lines=_found(members, timed, told))


def _lines(timed: Iteration) -> Float64Array:
    return np.asarray(timed.observations.line_s)


def _deviations(timed: Iteration) -> Float64Array:
    return np.zeros(0) if timed.lines is None else timed.lines.stddev_s


def _normal(timed: Iteration, state: BundleState) -> _Normal:
    o = timed.observations
    N, C, J = o.seen.shape
    known = state.used.sum(1) >= 2
    cluster = clusters(o, known, n_unknowns=(CAMERA + 1) * C)
    labels, n = cluster.ravel(), int(cluster.max(initial=-1)) + 1
    scale = CAUCHY * max(robust_scale(errors_px(o, state), state.used), MIN_SCALE_PX)
    size = (CAMERA + 1) * C
    H, scores = np.zeros((size, size)), np.zeros((size, n))
    poses = Cameras(state.R_cam_ref, state.t_cam_ref, state.shift_s)
    X = state.X.reshape(-1, 3)
    for rows in row_blocks(N, C * J):
        block = Block(o, state.used, state.V, state.A, rows)
        part, points = block.at(poses, X[block.points]).with_lines(scale)
        H += part
        mine = labels[block.points]
        for k, one in enumerate(points):
            scores[k] += np.bincount(mine, weights=one, minlength=n)
    return _Normal(H, scores, state)


def _adjusted(timed: Iteration, line_s: Float64Array, o: BundleOptions, *, last: bool) -> Iteration:
    """The round with other line times, adjusted from where it is."""
    observations = replace(timed.observations, line_s=line_s)
    return readjusted(timed, observations, o, last=last)


def _found(members: Sequence[LiftedCamera], timed: Iteration, told: BoolArray) -> LineDelays:
    """Line times of a round that is adjusted to them, with what they leave unknown."""
    k = CAMERA * len(members)
    normal = _normal(timed, timed.state)
    (_, P), (_, P_known) = normal.solved(told), normal.solved(np.zeros_like(told))
    middle = np.array([m.shutter.middle_row for m in members])
    given = np.array([m.shutter.line_time_s for m in members])
    K, J = _to_first_row(middle), to_reference(timed.state)
    late = (_lines(timed) - given) * middle
    return LineDelays(
        _lines(timed),
        np.where(told, np.sqrt(np.diag(P)[k:]), normal.stddev(np.ones_like(told))),
        late[0] - late,
        J @ (K @ P @ K.T - P_known[:k, :k]) @ J.T,
    )


def _to_first_row(middle: Float64Array) -> Float64Array:
    """Derivative (7 C, 8 C) of cameras, offsets of row 0, by those of the middle row and lines."""
    C = len(middle)
    offsets = CAMERA * np.arange(C) + CAMERA - 1
    K = np.concatenate([np.eye(CAMERA * C), np.zeros((CAMERA * C, C))], 1)
    K[offsets, CAMERA * C + np.arange(C)] -= middle
    K[offsets, CAMERA * C] += middle[0]
    return K
