"""Epipolar geometry of two unsynchronised cameras: Sampson distance and two-view refinement.

This is the second cost of Section III-A, ``x^T [t]_x R x'``, in its first-order geometric
form and with the lag as an unknown: keypoints of the second camera are interpolated between
its frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.geometry.alignment import unit
from stcalib_ros.core.geometry.epipolar import depths, sampson, sampson_scale
from stcalib_ros.core.geometry.robust import MIN_NOISE_PX, NOISE_MARGIN, RMS_OVER_MEDIAN
from stcalib_ros.core.geometry.so3 import exp_so3, hat
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.registration.correspondences import (
    MAX_POINTS,
    Correspondences,
    MatchedTracks,
)
from stcalib_ros.core.registration.limits import (
    CORRELATED_KEYPOINTS,
    KEYPOINT_SCALE_PX,
    MAX_STEP_ROTATION,
    MIN_BASELINE_M,
    MIN_POINTS,
)
from stcalib_ros.core.registration.pose_prior import PosePrior

_ITERATIONS = 10
"""Steps at most. Numerical: it starts near, and converges in about five."""
_FIRST_DAMPING = 1e-3
"""Factor on the diagonal of the normal equations. Numerical: Levenberg-Marquardt."""
_MAX_DAMPING = 1e3
"""Factor on the diagonal. Numerical: with more a step is too short to help, so that it ends."""
_CONVERGED = 0.3
"""Ratio to the cost of one keypoint, which is what a standard deviation of an unknown changes.
Numerical: it has converged when a step gains less."""


def refine_pair(
    cameras: Sequence[LiftedCamera],
    h: RelativePose,
    *,
    synchronised: bool = False,
    prior: PosePrior | None = None,
    max_points: int = MAX_POINTS,
) -> RelativePose | None:
    """Minimize the robust Sampson error over rotation, direction of t and lag (Gauss-Newton).

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    h : RelativePose
        Where it starts from.
    synchronised : bool
        The lag stays as it is.
    prior : PosePrior, optional
        Gaussian prior on rotation and direction.
    max_points : int
        Keypoints that are compared, about.

    Returns
    -------
    RelativePose or None
        With `epipolar_px` set, and as `support` the number of common keypoints that agree with it;
        None where too few are shared or it diverged.
    """
    matched = MatchedTracks(cameras[h.a], cameras[h.b], h.matches, max_points)
    max_lag_step = 0.0 if synchronised else 2.0 * matched.period
    damping = _FIRST_DAMPING
    c = matched.at(h.lag_s)
    if len(c.x_a) < MIN_POINTS or np.linalg.norm(h.t_a_b) < MIN_BASELINE_M:
        return None
    if prior is not None:
        prior = prior.against(max(1.0, CORRELATED_KEYPOINTS / matched.stride))
    noise = _noise(h, c, matched.white_px)
    cost = _cost(h, c, noise, prior)
    for _ in range(_ITERATIONS):
        trial = _step(h, c, noise, prior, damping, max_lag_step=max_lag_step)
        c_trial = matched.at(trial.lag_s)
        if len(c_trial.x_a) < MIN_POINTS:
            return None
        if (trial_cost := _cost(trial, c_trial, noise, prior)) < cost:
            converged = cost - trial_cost < _CONVERGED * cost / len(c_trial.x_a)
            h, c, damping = trial, c_trial, damping / 5.0
            noise = _noise(h, c, matched.white_px)
            cost = _cost(h, c, noise, prior)
            if converged:
                break
        else:
            damping *= 10.0
            if damping > _MAX_DAMPING:
                break
    return _judged(h, c, matched.stride)


def _judged(h: RelativePose, c: Correspondences, stride: int) -> RelativePose:
    """Set the length of t by the size of the people, and measure what agrees."""
    distances = np.abs(_distances_px(h, c))
    depth_a, depth_b = depths(h.R_a_b, unit(h.t_a_b), c.x_a, c.x_b)
    ahead = (depth_a > 0.0) & (depth_b > 0.0)
    agrees = ahead / (1.0 + (distances / KEYPOINT_SCALE_PX) ** 2)
    ratio = np.concatenate([(c.depth_a / depth_a)[ahead], (c.depth_b / depth_b)[ahead]])
    ratio = ratio[np.isfinite(ratio)]
    length = float(np.median(ratio)) if len(ratio) else float(np.linalg.norm(h.t_a_b))
    return replace(
        h,
        t_a_b=unit(h.t_a_b) * length,
        support=float(agrees.sum() * stride),
        epipolar_px=float(np.median(distances)),
    )


def _distances_px(h: RelativePose, c: Correspondences, white: float = 0.0) -> Float64Array:
    variance_b = 1.0 - white * (1.0 - c.variance_b)
    return sampson(hat(h.t_a_b) @ h.R_a_b, c.x_a, c.x_b, variance_b) * c.focal


@dataclass(frozen=True, slots=True)
class _Noise:
    """Scale of the Cauchy loss, px, and the fraction of the variance that is new in every image.

    Only that part is smaller between two images than in one of them. If it is neglected, lags are
    biased towards where keypoints are averaged; if all of the variance is taken for it, away from
    there.
    """

    scale: float
    white: float


def _noise(h: RelativePose, c: Correspondences, white_px: float) -> _Noise:
    """Return the noise of the distances of a hypothesis, by their median."""
    stddev = RMS_OVER_MEDIAN * float(np.median(np.abs(_distances_px(h, c))))
    white = min(1.0, (white_px / max(stddev, 1e-9)) ** 2)
    return _Noise(max(MIN_NOISE_PX, NOISE_MARGIN * stddev), white)


def _cost(h: RelativePose, c: Correspondences, noise: _Noise, prior: PosePrior | None) -> float:
    """Mean Cauchy loss, and the prior as a part of it."""
    r = _distances_px(h, c, noise.white) / noise.scale
    loss = float(np.log1p(r**2).mean())
    if prior is None:
        return loss
    turned, moved = prior.residuals(h)
    return loss + float(turned @ turned + moved @ moved) / len(r)


def _step(
    h: RelativePose,
    c: Correspondences,
    noise: _Noise,
    prior: PosePrior | None,
    damping: float,
    *,
    max_lag_step: float,
) -> RelativePose:
    """Return the relative pose after one damped Gauss-Newton step."""
    t = unit(h.t_a_b)
    tangent = np.linalg.svd(t[None])[2][1:]
    r, J = _linearized(h, c, noise, t, tangent, lag_is_free=max_lag_step > 0)
    w = 1.0 / (1.0 + r**2)
    H = J.T @ (w[:, None] * J)
    g = J.T @ (w * r)
    if prior is not None:
        turned, moved = prior.residuals(h)
        stddevs = np.repeat([prior.rotation_stddev, prior.direction_stddev], [3, 2])
        H[range(5), range(5)] += stddevs**-2
        g[:5] += np.concatenate([turned, tangent @ moved]) / stddevs
    H[range(6), range(6)] *= 1.0 + damping
    H[range(6), range(6)] += 1e-12 * np.trace(H)
    step = -np.linalg.solve(H, g)
    step[:3] *= min(1.0, MAX_STEP_ROTATION / max(float(np.linalg.norm(step[:3])), 1e-12))
    length = float(np.linalg.norm(h.t_a_b))
    return replace(
        h,
        R_a_b=exp_so3(step[:3]) @ h.R_a_b,
        t_a_b=unit(t + tangent.T @ step[3:5]) * length,
        lag_s=h.lag_s + float(np.clip(step[5], -max_lag_step, max_lag_step)),
    )


def _linearized(
    h: RelativePose,
    c: Correspondences,
    noise: _Noise,
    t: Float64Array,
    tangent: Float64Array,
    *,
    lag_is_free: bool,
) -> tuple[Float64Array, Float64Array]:
    """Sampson distances (M,) over their scale, and derivatives (M, 6) by rotation, t and lag.

    Parameters
    ----------
    t : (3,) ndarray
        Direction of t_a_b.
    tangent : (2, 3) ndarray
        Directions in which it can move.
    lag_is_free : bool
        Else the derivative by the lag is zero.
    """
    E = hat(t) @ h.R_a_b
    # Numerator and derivatives are all of the form x_a^T B x_b.
    forms = np.concatenate([E[None], hat(t) @ hat(np.eye(3)) @ h.R_a_b, hat(tangent) @ h.R_a_b])
    products = (c.x_a[:, :, None] * c.x_b[:, None, :]).reshape(-1, 9)
    values = forms.reshape(6, 9) @ products.T
    line_b = c.x_a @ E
    denominator = sampson_scale(c.x_b @ E.T, line_b, 1.0 - noise.white * (1.0 - c.variance_b))
    inverse = c.focal / denominator / noise.scale
    r = values[0] * inverse
    # Without its second term the step would follow noise, common to differences of images.
    later = (c.x_a * (c.v_b @ E.T)).sum(-1)
    rate = noise.white * c.variance_rate_b * (line_b[:, :2] ** 2).sum(-1)
    later -= values[0] * rate / denominator**2 / 2.0
    values[:5] = values[1:]
    values[5] = later * lag_is_free
    return r, (values * inverse).T
