"""The adjustment without the view-dependent biases of the keypoints.

The biases are found on a part of the images, together with the cameras: that is enough, as they
stay the same. Then the keypoints are corrected by them, and all are adjusted once more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.covariance import EliminatedUnknown
from stcalib_ros.core.bundle.istba import finish_iteration
from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.levenberg_marquardt import adjust
from stcalib_ros.core.bundle.limits import NEAREST
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.outliers import drop_outliers, image_points
from stcalib_ros.core.bundle.parameters import ParameterLayout
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
from stcalib_ros.core.refinement.limits import MIN_LOG_EVIDENCE

_KEYPOINTS = 8_000
"""Count. About so many keypoints are enough to determine the biases. Measured on the scenes
"bias" of benchmarks.accuracy.level: more do not change the errors."""

_FIRST_TOLERANCE = 1.0
"""Standard deviations. End of the adjustment before outliers are removed. Numerical."""

_LAST_TOLERANCE = 0.05
"""Standard deviations. End of the adjustment to the corrected keypoints. Numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class UnbiasedRound:
    """A round without the biases of its keypoints.

    Attributes
    ----------
    round : Iteration
        Its keypoints are corrected by the biases.
    layout : ParameterLayout
        Unknowns of the cameras that the biases were estimated with.
    log_evidence : float
        Logarithm of the ratio of the marginal likelihoods with and without biases.
    fit : BiasFit
    system : EliminatedBiases
        There.
    persons : (P,) ndarray of int
        Numbers of the persons whose biases the fit holds.
    """

    round: Iteration
    layout: ParameterLayout
    log_evidence: float
    fit: BiasFit
    system: EliminatedBiases
    persons: IntArray

    def added_covariance(self, layout: ParameterLayout) -> Float64Array:
        """Additional covariance of the cameras due to the unknown biases.

        Parameters
        ----------
        layout : ParameterLayout
            Unknowns that the fit did not have get none.
        """
        free, known = (
            self.layout.inverse(H, self.fit.cameras)
            for H in (self.system.system.H, self.system.known)
        )
        finite = np.isfinite(free) & np.isfinite(known)
        added = np.where(finite, free, 0.0) - np.where(finite, known, 0.0)
        mine, theirs = self.layout.common(layout)
        out = np.zeros((layout.size, layout.size))
        out[np.ix_(theirs, theirs)] = added[np.ix_(mine, mine)]
        return out

    def unknowns(
        self, joint_names: Sequence[str], layout: ParameterLayout
    ) -> dict[str, EliminatedUnknown]:
        """Biases by name, ``person0.left_knee.keypoint_bias``, beside the cameras of a layout."""
        mine, theirs = self.layout.common(layout)
        out = {}
        for i, person in enumerate(self.persons.tolist()):
            for j, joint in enumerate(joint_names):
                one = self.system.unknown(i, j)
                gain = np.zeros((len(one.gain), layout.size))
                gain[:, theirs] = one.gain[:, mine]
                out[f"person{person}.{joint}.keypoint_bias"] = replace(one, gain=gain)
        return out


def refine_keypoint_bias(
    cameras: Sequence[LiftedCamera],
    last: Iteration,
    layout: Layout,
    options: BundleOptions,
    unknowns: ParameterLayout | None = None,
) -> UnbiasedRound | None:
    """Adjust a round together with the biases of the keypoints.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
    last : Iteration
    layout : Layout
    options : BundleOptions
    unknowns : ParameterLayout, optional
        Those of the cameras; default: poses and time offsets.

    Returns
    -------
    UnbiasedRound or None
        None where biases explain nothing, or the layout has no trunk from which the orientation of
        a person follows.
    """
    trunk = trunk_of(layout)
    if trunk is None:
        return None
    problem = Problem(*_thinned(last), trunk, unknowns)
    solved = problem.solve()
    if solved is None:
        return None
    fit, system = solved
    log_evidence = problem.log_evidence(fit, system)
    if not log_evidence > MIN_LOG_EVIDENCE:
        return None
    persons: IntArray = np.unique(problem.obs.person)
    obs = _corrected(last, fit, persons, trunk)
    after = _adjusted(cameras, last, obs, fit, options, problem.layout)
    return UnbiasedRound(after, problem.layout, log_evidence, fit, system, persons)


def _thinned(last: Iteration) -> tuple[Observations, BundleState]:
    """Every n-th row, so that about as many keypoints are left as determine the biases."""
    obs, state = last.observations, last.state
    every = max(1, round(int(state.inlier.sum()) / _KEYPOINTS))
    rows: IntArray = np.arange(0, len(obs.person), every)
    thin = state.only(rows)
    return obs.only(rows), thin.with_inliers(thin.inlier)


def _adjusted(
    cameras: Sequence[LiftedCamera],
    last: Iteration,
    obs: Observations,
    fit: BiasFit,
    options: BundleOptions,
    layout: ParameterLayout,
) -> Iteration:
    """Adjust the round with corrected keypoints, from the fit on."""
    known = last.state.triangulated()
    state = last.state.with_cameras(fit.cameras)
    n = options.max_iterations
    state = adjust(obs, state, iterations=n, tolerance=_FIRST_TOLERANCE, layout=layout)
    V, A = estimate_motion(obs, state.X, known)
    state = drop_outliers(obs, replace(state, V=V, A=A), options)
    state = adjust(obs, state, iterations=n, tolerance=_LAST_TOLERANCE, layout=layout)
    before = replace(last.rig, offset_s=last.rig.offset_s - last.state.shift_s)
    total = image_points([cameras[c] for c in last.rig.cameras])
    return finish_iteration(before, last.association, obs, state, total, coverage=last.coverage)


def _corrected(
    last: Iteration, fit: BiasFit, persons: IntArray, trunk: tuple[int, ...]
) -> Observations:
    """Keypoints where they would be without the biases of a fit.

    Those of people who are not among the persons (P,) of the fit stay: it had no row of them.
    """
    obs = last.observations
    x = obs.x.copy()
    for part in parts_of(obs, last.state, trunk):
        of_fit = np.flatnonzero(persons == obs.person[part.rows.start])
        if not len(of_fit):
            continue
        bias = fit.bias[of_fit[0]]
        X = last.state.X[part.rows].transpose(2, 1, 0)
        for c, (R, t) in enumerate(zip(fit.cameras.R, fit.cameras.t, strict=True)):
            Y = np.tensordot(R, X, 1) + t[:, None, None]
            shifted = Y + np.tensordot(R, part.displacement(c, bias), 1)
            ahead = (Y[2] > NEAREST) & (shifted[2] > NEAREST)
            depth, shifted_depth = np.where(ahead, (Y[2], shifted[2]), np.inf)
            moved = shifted[:2] / shifted_depth - Y[:2] / depth
            x[part.rows, c] -= moved.transpose(2, 1, 0)
    return replace(obs, x=np.where(obs.observed[..., None], x, obs.x))
