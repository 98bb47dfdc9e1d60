"""The last stage: the adjustment without what the key points lean by.

The biases are found on a part of the images, which is enough: they stay the same. Then the image
points are put back by them, and all of them are adjusted once more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.covariance import information_covariance
from stcalib_ros.core.bundle.istba import finish_iteration
from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.levenberg_marquardt import adjust
from stcalib_ros.core.bundle.normal_equations import NEAREST
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.outliers import drop_outliers, image_points
from stcalib_ros.core.bundle.state import BundleState, estimate_motion
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.options import BundleOptions
from stcalib_ros.core.refinement.keypoint_bias.harmonics import trunk_of
from stcalib_ros.core.refinement.keypoint_bias.solver import (
    BiasFit,
    EliminatedBiases,
    Problem,
    parts_of,
)

_IMAGE_POINTS = 8_000
_DECISIVE = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """The result of the last stage.

    Attributes
    ----------
    round : Iteration
        Its image points are put back by the biases.
    excess : (7 C, 7 C) ndarray
        What not to know the biases adds to the covariance of the cameras.
    gain : float
        By how much biases explain the image points better: logarithm of the ratio of the
        marginal likelihoods.
    spread : float
        Root mean square of a component of the biases, in the unit of the round.
    """

    round: Iteration
    excess: Float64Array
    gain: float
    spread: float


def refine_keypoint_bias(
    cameras: Sequence[LiftedCamera], last: Iteration, layout: Layout, o: BundleOptions
) -> Refined | None:
    """Adjust a round together with the biases of the key points.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
    last : Iteration
    layout : Layout
    o : BundleOptions

    Returns
    -------
    Refined or None
        None where biases explain nothing, or the layout has no trunk that tells how a person is
        turned.
    """
    trunk = trunk_of(layout)
    if trunk is None:
        return None
    problem = Problem(*_thinned(last), trunk)
    solved = problem.solve()
    if solved is None:
        return None
    fit, e = solved
    gain = problem.log_gain(fit, e)
    if not gain > _DECISIVE:
        return None
    after = _adjusted(cameras, last, fit, trunk, o)
    return Refined(
        after,
        _excess(problem, fit, e),
        gain,
        float(np.sqrt((fit.bias**2).sum(-1).mean())),
    )


def _thinned(last: Iteration) -> tuple[Observations, BundleState]:
    """Every n-th row, so that about as many image points are left as tell the biases."""
    o, s = last.observations, last.state
    every = max(1, round(int(s.used.sum()) / _IMAGE_POINTS))
    rows: IntArray = np.arange(0, len(o.person), every)
    thin = s.only(rows)
    used = thin.used & (thin.used.sum(1) >= 2)[:, None]
    return o.only(rows), replace(thin, used=used)


def _adjusted(
    cameras: Sequence[LiftedCamera],
    last: Iteration,
    fit: BiasFit,
    trunk: tuple[int, ...],
    b: BundleOptions,
) -> Iteration:
    """The round with image points put back, adjusted from the fit on."""
    o = _put_back(last, fit, trunk)
    known = last.state.used.sum(1) >= 2
    state = replace(
        last.state,
        R_cam_ref=fit.cameras.R,
        t_cam_ref=fit.cameras.t,
        shift_s=fit.cameras.shift,
    )
    state = adjust(o, state, iterations=b.max_iterations, tolerance=1.0)
    V, A = estimate_motion(o, state.X, known)
    state = drop_outliers(o, replace(state, V=V, A=A), b)
    state = adjust(o, state, iterations=b.max_iterations, tolerance=0.05)
    before = replace(last.rig, offset_s=last.rig.offset_s - last.state.shift_s)
    total = image_points([cameras[c] for c in last.rig.cameras])
    return finish_iteration(before, last.association, o, state, total, coverage=last.coverage)


def _put_back(last: Iteration, fit: BiasFit, trunk: tuple[int, ...]) -> Observations:
    """Image points where they would be without the biases of a fit."""
    o = last.observations
    x = o.x.copy()
    for part in parts_of(o, last.state, trunk):
        X = last.state.X[part.rows].transpose(2, 1, 0)
        for c, (R, t) in enumerate(zip(fit.cameras.R, fit.cameras.t, strict=True)):
            Y = np.tensordot(R, X, 1) + t[:, None, None]
            shifted = Y + np.tensordot(R, part.displacement(c, fit.bias[part.person]), 1)
            ahead = (Y[2] > NEAREST) & (shifted[2] > NEAREST)
            depth, shifted_depth = np.where(ahead, (Y[2], shifted[2]), np.inf)
            moved = shifted[:2] / shifted_depth - Y[:2] / depth
            x[part.rows, c] -= moved.transpose(2, 1, 0)
    return replace(o, x=np.where(o.seen[..., None], x, o.x))


def _excess(problem: Problem, fit: BiasFit, e: EliminatedBiases) -> Float64Array:
    """What not to know the biases adds to the covariance (7 C, 7 C) of the cameras."""
    state = replace(problem.state, R_cam_ref=fit.cameras.R, t_cam_ref=fit.cameras.t)
    return information_covariance(e.system.H, state) - information_covariance(e.known, state)
