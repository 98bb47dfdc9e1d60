"""Which change of which camera explains its residuals to the others, and how well.

Each camera is tested by itself: a change of its pose and clock is fitted to the observations of all
others, which are held. A camera that has moved disagrees with all others, and only its own change
reduces all these residuals; the next one is then tested with the first one corrected.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.geometry.robust import NOISE_MARGIN, RMS_OVER_MEDIAN
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.monitoring.limits import (
    CORRELATED_POINTS,
    MAX_FIT_PX,
    MAX_FIT_RATIO,
    MIN_GAIN_TO_CORRECT,
    MIN_POINTS,
    MIN_POINTS_OF_PAIR,
    MIN_SHIFT_GAIN,
    MIN_SHIFT_GAIN_RATIO,
    PRIOR_STDDEV,
    RIVAL_GAIN_RATIO,
)
from stcalib_ros.core.monitoring.matching import SpanObservations

ROTATION, SHIFT, CLOCK = slice(0, 3), slice(3, 6), 6
"""Positions of the parameters of a change."""
N_CHANGES = 7
"""Number of parameters of a change: three of rotation, three of displacement, one of the clock."""

_ALL_PARAMETERS = np.arange(N_CHANGES)
"""Positions of the parameters of any change."""
_ROTATION_AND_CLOCK = np.delete(_ALL_PARAMETERS, SHIFT)
"""Positions of the parameters of a change without a displacement."""

_MAX_POINTS = 900
"""Pairs of keypoints of one camera, count; of more, a regular part is compared that represents all.
Cost alone."""
_ITERATIONS = 6
"""Gauss-Newton steps of one fit at most; bounds the cost of a fit that does not converge."""
_CONVERGED = np.repeat([1e-4, 1e-3, 1e-4], [3, 3, 1])
"""Step (rad, m, s) below which a fit has converged; far below the thresholds of an alarm."""
_ALTERNATIONS = 3
"""Passes over the cameras that have changed, each refitted with the others corrected."""
_MIN_NORMAL_SQUARED = 1e-18
"""Squared gradient of an epipolar constraint; keeps points at an epipole from dividing by zero."""


@dataclass(frozen=True, slots=True, eq=False)
class ChangeFit:
    """The best fitting change of one camera.

    Attributes
    ----------
    change : (7,) ndarray
        Rotation vector in the optical frame (rad), displacement of the centre in the optical frame
        (m), and correction of the time offset (s); zero where nothing is gained.
    information : (7, 7) ndarray
        Inverse covariance; zero for parameters that were not estimated.
    before_px, after_px : float
        Median epipolar distance to the other cameras without and with the change; NaN without
        points.
    gain : float
        Log-likelihood gained by the change, at least 0.
    n_points : int
        Number of compared pairs of keypoints.
    left_px : (C,) ndarray
        Robust standard deviation of the epipolar distance to every camera that the change leaves,
        or that there is without it where that is less; NaN where nobody is common.
    """

    change: Float64Array
    information: Float64Array
    before_px: float
    after_px: float
    gain: float
    n_points: int
    left_px: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """Result of one span for one camera.

    Attributes
    ----------
    fit : ChangeFit
        Fit with all cameras corrected that gain more.
    expected_px : float
        Usual epipolar distance to the others, standard deviation.
    depth_m : float
        Median distance of the people; NaN if nobody was observed.
    n_steps : int
        Number of time steps of the span.
    expected, matched, missed : int
        Numbers of time steps, as in `SpanObservations`.
    rivals : tuple of str
        Other cameras whose change alone would explain about as much as this one's.
    """

    fit: ChangeFit
    expected_px: float
    depth_m: float
    n_steps: int
    expected: int
    matched: int
    missed: int
    rivals: tuple[str, ...] = ()


def detect_changes(obs: SpanObservations, noise: Float64Array) -> tuple[Finding, ...]:
    """Fit a change of every camera, those that gain most first.

    Parameters
    ----------
    obs : SpanObservations
    noise : (C, C) ndarray
        Usual epipolar distance of every two cameras, standard deviation, px.
    """
    fits, rivals = _attribute(_without_implausible(obs, noise), noise)
    return tuple(
        Finding(
            fit=fits[c],
            expected_px=float(np.median(np.delete(noise[c], c))),
            depth_m=float(obs.depth_m[c]),
            n_steps=obs.x.shape[2],
            expected=int(obs.expected[c]),
            matched=int(obs.matched[c]),
            missed=int(obs.missed[c]),
            rivals=tuple(obs.names[j] for j in sorted(rivals[c])),
        )
        for c in range(len(obs.names))
    )


def _attribute(
    obs: SpanObservations, noise: Float64Array
) -> tuple[list[ChangeFit], list[set[int]]]:
    """Fit all cameras; return the fits, and for each camera those that explain it as well."""
    C = len(obs.names)
    fits = [best_fit(obs, c, noise[c]) for c in range(C)]
    changes: dict[int, Float64Array] = {}
    rivals: list[set[int]] = [set() for _ in range(C)]
    left = set(range(C))
    for _ in range(C // 2):
        worst = max(sorted(left), key=lambda c: fits[c].gain, default=-1)
        if worst < 0 or fits[worst].gain < MIN_GAIN_TO_CORRECT:
            break
        left.remove(worst)
        changes[worst] = fits[worst].change
        for c in [*changes] * (_ALTERNATIONS if len(changes) > 1 else 0):
            fits[c] = best_fit(_corrected(obs, changes, but=c), c, noise[c])
            changes[c] = fits[c].change
        corrected = _corrected(obs, changes)
        for c in sorted(left):
            fit = best_fit(corrected, c, noise[c])
            close = fits[c].gain >= RIVAL_GAIN_RATIO * fits[worst].gain
            if close and (fit.gain < MIN_GAIN_TO_CORRECT or C == 2):
                rivals[c].add(worst)
                rivals[worst].add(c)
                left.remove(c)
            else:
                fits[c] = fit
    return fits, rivals


def _without_implausible(obs: SpanObservations, noise: Float64Array) -> SpanObservations:
    """Remove tentative persons that no change of their camera makes fit."""
    x = obs.x.copy()
    for c in np.flatnonzero(obs.tentative).tolist():
        if not explains(best_fit(obs, c, noise[c]), float(np.median(np.delete(noise[c], c)))):
            x[c] = np.nan
    return replace(obs, x=x)


def explains(fit: ChangeFit, expected_px: float) -> bool:
    """Whether the residual that a change leaves is about that of the calibration."""
    return fit.after_px <= max(MAX_FIT_RATIO * expected_px, MAX_FIT_PX)


def _corrected(
    obs: SpanObservations, changes: Mapping[int, Float64Array], *, but: int = -1
) -> SpanObservations:
    """Apply the changes of cameras, except of one, to rig and observations."""
    R, t, x = obs.rig.R_ref_cam.copy(), obs.rig.t_ref_cam.copy(), obs.x.copy()
    for c, change in changes.items():
        if c != but:
            t[c] = t[c] + R[c] @ change[SHIFT]
            R[c] = R[c] @ exp_so3(change[ROTATION])
            x[c] -= change[CLOCK] * obs.v[c]
    return replace(obs, rig=replace(obs.rig, R_ref_cam=R, t_ref_cam=t), x=x)


def best_fit(obs: SpanObservations, c: int, noise_px: Float64Array) -> ChangeFit:
    """Fit a rotation and a clock jump; a displacement, too, where that explains clearly more."""
    points = _PointPairs.of(obs, c, noise_px)
    turned = fit_change(points, _ROTATION_AND_CLOCK)
    as_calibrated = RMS_OVER_MEDIAN * turned.before_px <= float(np.median(noise_px))
    if turned.n_points < MIN_POINTS or as_calibrated:
        return turned
    moved = fit_change(points, _ALL_PARAMETERS)
    needed = MIN_SHIFT_GAIN_RATIO * turned.gain + MIN_SHIFT_GAIN
    return moved if moved.gain > needed else turned


def fit_change(points: _PointPairs, parameters: IntArray) -> ChangeFit:
    """Estimate some of the seven parameters by robust Gauss-Newton; the others are held at 0."""
    zero, none = np.zeros(N_CHANGES), np.zeros((N_CHANGES, N_CHANGES))
    M, n = len(points.x), points.n
    if M < MIN_POINTS:
        return ChangeFit(zero, none, np.nan, np.nan, 0.0, M, np.full(points.n_cameras, np.nan))
    independent = n / M / CORRELATED_POINTS
    free = np.ix_(parameters, parameters)
    change, (start, J) = zero, points.residuals(zero)
    r = start
    for _ in range(_ITERATIONS):
        scale = np.maximum(points.noise, NOISE_MARGIN * RMS_OVER_MEDIAN * np.median(np.abs(r)))
        w = independent / (scale**2 + r**2)
        A = (J.T * w) @ J + np.diag(PRIOR_STDDEV**-2.0)
        g = (J.T * w) @ r + change / PRIOR_STDDEV**2
        step = np.zeros(N_CHANGES)
        step[parameters] = -np.linalg.solve(A[free], g[parameters])
        change = change + step
        r, J = points.residuals(change)
        if np.abs(step / _CONVERGED).max() < 1.0:
            break
    gain = np.log1p((start / points.noise) ** 2) - np.log1p((r / points.noise) ** 2)
    total = 0.5 * independent * float(gain.sum())
    before, after = (float(np.median(np.abs(values))) for values in (start, r))
    if total <= 0:
        change, total, after = zero, 0.0, before
    information = none.copy()
    information[free] = ((J.T * independent / (points.noise**2 + r**2)) @ J)[free]
    left = np.fmin(points.spread(start), points.spread(r))
    return ChangeFit(change, information, before, after, total, n, left)


@dataclass(frozen=True, slots=True, eq=False)
class _PointPairs:
    """Keypoints of one camera, each with that of the same joint in another camera."""

    x: Float64Array  # (M, 3) on the plane z = 1
    v: Float64Array  # (M, 3) its time derivative, per second
    y: Float64Array  # (M, 3) direction of the other camera's ray, in the frame of this camera
    t: Float64Array  # (M, 3) centre of the other camera, in the frame of this camera
    R: Float64Array  # (M, 3, 3) R_cam_other
    focal: Float64Array  # (M,) px
    noise: Float64Array  # (M,) px
    n: int  # number of pairs that the M represent
    other: IntArray  # (M,) the other camera
    n_cameras: int

    @staticmethod
    def of(obs: SpanObservations, c: int, noise_px: Float64Array) -> _PointPairs:
        """Pair the keypoints of camera c with those of all others."""
        C = len(obs.names)
        others = [j for j in range(C) if j != c]
        parts = [_pair(obs, c, j, float(noise_px[j])) for j in others]
        n = sum(len(part[0]) for part in parts)
        stride = max(1, -(-n // _MAX_POINTS))
        x, v, y, t, R, focal, noise = (
            np.concatenate(column)[::stride] for column in zip(*parts, strict=True)
        )
        other = np.repeat(others, [len(part[0]) for part in parts])[::stride]
        return _PointPairs(
            x=x, v=v, y=y, t=t, R=R, focal=focal, noise=noise, n=n, other=other, n_cameras=C
        )

    def spread(self, residuals: Float64Array) -> Float64Array:
        """Robust standard deviation (C,) of residuals (M,), by the other camera."""
        size = np.abs(residuals)
        of_camera = [size[self.other == j] for j in range(self.n_cameras)]
        return np.array(
            [
                RMS_OVER_MEDIAN * float(np.median(one))
                if len(one) >= MIN_POINTS_OF_PAIR
                else np.nan
                for one in of_camera
            ]
        )

    def residuals(self, change: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return signed Sampson distances (M,), px, and their derivatives (M, 7).

        The scale of the Sampson distance is held in the derivative: exact where the residual is 0.
        """
        x = (self.x - change[CLOCK] * self.v) @ exp_so3(change[ROTATION]).T
        v = self.v @ exp_so3(change[ROTATION]).T
        t = self.t - change[SHIFT]
        n = np.cross(t, self.y)
        line = np.einsum("mba,mb->ma", self.R, np.cross(x, t))
        scale = self.focal / np.sqrt(
            np.maximum((n[:, :2] ** 2).sum(-1) + (line[:, :2] ** 2).sum(-1), _MIN_NORMAL_SQUARED)
        )
        J = np.column_stack([np.cross(x, n), np.cross(x, self.y), -(v * n).sum(-1)])
        return (x * n).sum(-1) * scale, J * scale[:, None]


def _pair(obs: SpanObservations, c: int, j: int, noise_px: float) -> tuple[Float64Array, ...]:
    """Return the arrays of `_PointPairs` for the keypoints that cameras c and j have in common."""
    both = np.isfinite(obs.x[c, ..., 0] + obs.x[j, ..., 0] + obs.v[c, ..., 0])
    x, v, other = obs.x[c][both], obs.v[c][both], obs.x[j][both]
    R = obs.rig.R_ref_cam[c].T @ obs.rig.R_ref_cam[j]
    t = obs.rig.R_ref_cam[c].T @ (obs.rig.t_ref_cam[j] - obs.rig.t_ref_cam[c])
    M = len(x)
    focal = np.sqrt(obs.focal[c][both] * obs.focal[j][both])
    y, centres, rotations = other @ R.T, np.tile(t, (M, 1)), np.tile(R, (M, 1, 1))
    return x, v, y, centres, rotations, focal, np.full(M, noise_px)
