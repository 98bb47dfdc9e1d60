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
from stcalib_ros.core.geometry.epipolar import sampson, sampson_scale
from stcalib_ros.core.geometry.interpolation import Interpolation, frame_period
from stcalib_ros.core.geometry.robust import MIN_NOISE_PX, NOISE_MARGIN, RMS_OVER_MEDIAN
from stcalib_ros.core.geometry.so3 import exp_so3, hat, log_so3
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.registration.limits import (
    CORRELATED_KEYPOINTS,
    MAX_STEP_ROTATION,
    MIN_BASELINE_M,
    MIN_POINTS,
)
from stcalib_ros.core.registration.pose_noise import registration_stddev

_MAX_POINTS = 1500
"""Keypoints of a pair that are compared, about. Numerical: bounds the cost."""
_ITERATIONS = 10
"""Steps at most. Numerical: it starts near, and converges in about five."""
_FIRST_DAMPING = 1e-3
"""Factor on the diagonal of the normal equations. Numerical: Levenberg-Marquardt."""
_MAX_DAMPING = 1e3
"""Factor on the diagonal. Numerical: with more a step is too short to help, so that it ends."""
_CONVERGED = 1e-3
"""Fraction of the cost. Numerical: it has converged when a step gains less."""
_MAX_NOISE_FRAMES = 300
"""Frames of a track by which noise is measured, at most. Numerical: bounds the cost."""


@dataclass(frozen=True, slots=True, eq=False)
class Correspondences:
    """Keypoints of matched tracks at one lag.

    Attributes
    ----------
    x_a, x_b : (M, 3) ndarray
        Homogeneous points on the planes z = 1.
    v_b : (M, 3) ndarray
        Time derivative of `x_b`, per second.
    variance_b : (M,) ndarray
        Variance of `x_b` over that of one keypoint, if the noise of every image is its own:
        between two images it is less.
    variance_rate_b : (M,) ndarray
        Time derivative of that, per second.
    focal : (M,) ndarray
        Pixels per unit of x, geometric mean of both cameras.
    """

    x_a: Float64Array
    x_b: Float64Array
    v_b: Float64Array
    variance_b: Float64Array
    variance_rate_b: Float64Array
    focal: Float64Array


def correspondences(
    cameras: Sequence[LiftedCamera], h: RelativePose, *, max_points: int = _MAX_POINTS
) -> Correspondences:
    """Matched keypoints at the lag of a hypothesis, thinned to about `max_points`."""
    return _Matched(cameras[h.a], cameras[h.b], h.matches, max_points).at(h.lag_s)


def white_noise_px(tracks: Sequence[LiftedTrack]) -> float:
    """Standard deviation (px, per axis) of the noise of keypoints that is new in every image.

    It is measured on third differences, which hardly contain the motion of a body.
    """
    differences = [np.zeros(0)]
    for track in tracks:
        rows = slice(None, _MAX_NOISE_FRAMES)
        pixels = track.x[rows] * track.focal[rows, :, None]
        following = np.flatnonzero(np.diff(track.frames[rows], n=1) == 1)
        runs = following[np.isin(following + 1, following) & np.isin(following + 2, following)]
        third = pixels[runs + 3] - 3.0 * pixels[runs + 2] + 3.0 * pixels[runs + 1] - pixels[runs]
        differences.append(np.abs(third[np.isfinite(third)]))
    every = np.concatenate(differences)
    return float(RMS_OVER_MEDIAN * np.median(every) / np.sqrt(20.0)) if len(every) else 0.0


class _Matched:
    """Matched tracks of two cameras, for their keypoints to be read off at any lag."""

    def __init__(
        self,
        cam_a: LiftedCamera,
        cam_b: LiftedCamera,
        matches: Sequence[tuple[int, int]],
        max_points: int,
    ) -> None:
        total = sum(cam_a.tracks[p].x.shape[0] * cam_a.tracks[p].x.shape[1] for p, _ in matches)
        stride = max(1, -(-total // max_points))
        self.tracks_a = [cam_a.tracks[p] for p, _ in matches]
        self.tracks_b = [cam_b.tracks[q] for _, q in matches]
        self.stamps_b = [cam_b.stamps[b.frames] for b in self.tracks_b]
        self.rows = [np.arange(0, len(a.frames), stride) for a in self.tracks_a]
        of_a = list(zip(self.tracks_a, self.rows, strict=True))
        self.times = [cam_a.stamps[a.frames[rows]] for a, rows in of_a]
        self.period = frame_period(cam_b.stamps)
        self.x_a = np.concatenate([a.x[rows] for a, rows in of_a])
        self.focal_a = np.concatenate([a.focal[rows] for a, rows in of_a])
        self.known_a = np.isfinite(self.x_a).all(-1)
        self.white_px = white_noise_px(self.tracks_b)

    def at(self, lag_s: float) -> Correspondences:
        """Return the keypoints of the same time if ``t_b - t_a`` is `lag_s`."""
        between = self._interpolations(lag_s)
        pieces = list(zip(between, self.tracks_b, strict=True))
        x_b, v_b = (np.concatenate(c) for c in zip(*(i.both(b.x) for i, b in pieces), strict=True))
        focal_b = np.concatenate([i(b.focal) for i, b in pieces])
        variance, rate = (
            np.concatenate(c) for c in zip(*(i.variance for i in between), strict=True)
        )
        good = np.flatnonzero(self.known_a & np.isfinite(x_b).all(-1))
        x_a, x_b, v_b = (one.reshape(-1, 2)[good] for one in (self.x_a, x_b, v_b))
        focal = np.sqrt(self.focal_a.ravel()[good] * focal_b.ravel()[good])
        frame = good // self.known_a.shape[1]
        one, zero = np.ones((len(good), 1)), np.zeros((len(good), 1))
        return Correspondences(
            np.hstack([x_a, one]),
            np.hstack([x_b, one]),
            np.hstack([v_b, zero]),
            variance[frame],
            rate[frame],
            focal,
        )

    def bodies(self, lag_s: float) -> tuple[Float64Array, Float64Array]:
        """Return the middles (K, 3) of the same bodies at the same times in both optical frames."""
        pieces = zip(
            self.tracks_a, self.rows, self.tracks_b, self._interpolations(lag_s), strict=True
        )
        pairs = [(a.root_cam[rows], at(b.root_cam)) for a, rows, b, at in pieces]
        body_a, body_b = (np.concatenate(column) for column in zip(*pairs, strict=True))
        both = np.isfinite(body_a + body_b).all(-1)
        return body_a[both], body_b[both]

    def _interpolations(self, lag_s: float) -> list[Interpolation]:
        return [
            Interpolation(stamps, times + lag_s, period=self.period)
            for stamps, times in zip(self.stamps_b, self.times, strict=True)
        ]


@dataclass(frozen=True, slots=True, eq=False)
class _Prior:
    """Rotation and direction of t by the 3D poses, and their standard deviations, rad."""

    R_a_b: Float64Array
    unit_t: Float64Array
    rotation: float
    direction: float

    def residuals(self, h: RelativePose) -> tuple[Float64Array, Float64Array]:
        """Residuals of rotation (3,) and direction (3,), in standard deviations."""
        turned = log_so3(h.R_a_b @ self.R_a_b.T) / self.rotation
        moved = (unit(h.t_a_b) - self.unit_t) / self.direction
        return turned, moved


def refine_pair(
    cameras: Sequence[LiftedCamera],
    h: RelativePose,
    *,
    synchronised: bool = False,
) -> RelativePose | None:
    """Minimize the robust Sampson error over rotation, direction of t and lag (Gauss-Newton).

    The registration that it starts from is a Gaussian prior, whose standard deviations are those
    of registrations by 3D poses like these.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    h : RelativePose
        Registration by 3D poses.
    synchronised : bool
        The lag stays as it is.

    Returns
    -------
    RelativePose or None
        With `epipolar_px` set; None where too few keypoints are shared or it diverged.
    """
    matched = _Matched(cameras[h.a], cameras[h.b], h.matches, _MAX_POINTS)
    max_lag_step = 0.0 if synchronised else 2.0 * matched.period
    damping = _FIRST_DAMPING
    c = matched.at(h.lag_s)
    if len(c.x_a) < MIN_POINTS or np.linalg.norm(h.t_a_b) < MIN_BASELINE_M:
        return None
    rotation_stddev, direction_stddev = registration_stddev(cameras[h.a], cameras[h.b], h)
    prior = _Prior(h.R_a_b, unit(h.t_a_b), rotation_stddev, direction_stddev)
    noise = _noise(h, c, matched.white_px)
    cost = _cost(h, c, prior, noise)
    for _ in range(_ITERATIONS):
        trial = _step(h, c, prior, noise, damping, max_lag_step=max_lag_step)
        c_trial = matched.at(trial.lag_s)
        if len(c_trial.x_a) < MIN_POINTS:
            return None
        if (trial_cost := _cost(trial, c_trial, prior, noise)) < cost:
            converged = cost - trial_cost < _CONVERGED * cost
            h, c, damping = trial, c_trial, damping / 5.0
            noise = _noise(h, c, matched.white_px)
            cost = _cost(h, c, prior, noise)
            if converged:
                break
        else:
            damping *= 10.0
            if damping > _MAX_DAMPING:
                break
    epipolar_px = float(np.median(np.abs(_distances_px(h, c))))
    h = _metric_length(h, *matched.bodies(h.lag_s))
    return replace(h, epipolar_px=epipolar_px)


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


def _cost(h: RelativePose, c: Correspondences, prior: _Prior, noise: _Noise) -> float:
    """Cauchy loss plus the prior."""
    r = _distances_px(h, c, noise.white) / noise.scale
    data = float(np.log1p(r**2).mean()) * len(r) / CORRELATED_KEYPOINTS
    turned, moved = prior.residuals(h)
    return data + float(turned @ turned + moved @ moved)


def _step(
    h: RelativePose,
    c: Correspondences,
    prior: _Prior,
    noise: _Noise,
    damping: float,
    *,
    max_lag_step: float,
) -> RelativePose:
    """Return the relative pose after one damped Gauss-Newton step."""
    t = unit(h.t_a_b)
    tangent = np.linalg.svd(t[None])[2][1:]
    r, J = _linearized(h, c, noise, t, tangent, lag_is_free=max_lag_step > 0)
    w = 1.0 / (1.0 + r**2) / CORRELATED_KEYPOINTS
    turned, moved = prior.residuals(h)
    H = J.T @ (w[:, None] * J)
    g = J.T @ (w * r)
    H[range(5), range(5)] += np.repeat([prior.rotation**-2, prior.direction**-2], [3, 2])
    g[:3] += turned / prior.rotation
    g[3:5] += tangent @ moved / prior.direction
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


def _metric_length(h: RelativePose, body_a: Float64Array, body_b: Float64Array) -> RelativePose:
    """Set length and sign of t by the positions of the monocular poses."""
    t = unit(h.t_a_b)
    along = (body_a - body_b @ h.R_a_b.T) @ t
    return replace(h, t_a_b=t * float(np.median(along))) if len(along) else h
