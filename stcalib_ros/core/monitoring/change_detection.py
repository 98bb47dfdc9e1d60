"""Which change of which camera would explain that it disagrees with the others, and how well.

Every camera is tried alone: its pose and its clock are fitted to what all others see, who stay
as they are. A camera that has moved makes all its pairs disagree, and only its own change mends
them all; then the next one is looked for, with the first one corrected.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.geometry.robust import MIN_NOISE_PX, NOISE_MARGIN, RMS_OVER_MEDIAN
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.monitoring.limits import (
    CORRELATED_KEYPOINTS,
    EXPLAINED_PX,
    EXPLAINED_RATIO,
    MIN_POINTS,
    RIVAL_RATIO,
    SHIFT_GAIN,
    SHIFT_GAIN_RATIO,
    WORTH_CORRECTING,
)
from stcalib_ros.core.monitoring.matching import SpanObservations

_ITERATIONS = 6
"""Gauss-Newton steps of a fit, at most. Numerical: changes are small."""
_PRIOR = np.repeat([0.3, 0.3, 0.5], [3, 3, 1])
"""Standard deviations of what may have happened: rad, m, s."""
_MAX_POINTS = 900
"""Of one camera beside all others; of more, a part is compared that stands for all."""
_ALTERNATIONS = 3
"""Times that the changes of several cameras are fitted in turn. Numerical: bounds the cost."""

ROTATION, SHIFT, CLOCK = slice(0, 3), slice(3, 6), 6
"""Where they are in the seven parameters of a change."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """The change of one camera that fits best.

    Attributes
    ----------
    change : (7,) ndarray
        Rotation vector in the optical frame (rad), displacement of the centre in the optical frame
        (m), and what is to be added to the time offset (s); zero where nothing is gained.
    information : (7, 7) ndarray
        Inverse covariance; zero for parameters that were held.
    before_px, after_px : float
        Median epipolar distance to the other cameras without and with the change; NaN without
        points.
    gain : float
        Log-likelihood that the change gains, at least 0.
    n_points : int
    """

    change: Float64Array
    information: Float64Array
    before_px: float
    after_px: float
    gain: float
    n_points: int


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """What one span of time says about one camera.

    Attributes
    ----------
    fit : Fit
        With all cameras corrected that gain more.
    promised_px : float
        Epipolar distance to the others that the calibration promises, root mean square.
    depth_m : float
        Usual distance of the people; NaN if nobody was seen.
    moments, expected, matched, blind : int
        As in `SpanObservations`; `moments` is their number.
    rivals : tuple of str
        Other cameras whose change alone would explain about as much as this one's.
    """

    fit: Fit
    promised_px: float
    depth_m: float
    moments: int
    expected: int
    matched: int
    blind: int
    rivals: tuple[str, ...] = ()


def detect_changes(sightings: SpanObservations, promised_px: Float64Array) -> tuple[Finding, ...]:
    """Fit a change of every camera, those that gain most first.

    Parameters
    ----------
    sightings : Sightings
    promised_px : (C, C) ndarray
        Root mean square epipolar distance of every two cameras that the calibration promises.
    """
    C = len(sightings.names)
    noise = np.maximum(promised_px, MIN_NOISE_PX)
    fits, alike = _attributed(_believable(sightings, noise), noise)
    return tuple(
        Finding(
            fits[c],
            float(np.median(np.delete(noise[c], c))),
            float(sightings.depth_m[c]),
            sightings.x.shape[2],
            int(sightings.expected[c]),
            int(sightings.matched[c]),
            int(sightings.blind[c]),
            tuple(sightings.names[j] for j in sorted(alike[c])),
        )
        for c in range(C)
    )


def _attributed(s: SpanObservations, noise: Float64Array) -> tuple[list[Fit], list[set[int]]]:
    """Fits of all cameras, and for each those that explain the same as well."""
    C = len(s.names)
    fits = [best_fit(s, c, noise[c]) for c in range(C)]
    changes: dict[int, Float64Array] = {}
    alike: list[set[int]] = [set() for _ in range(C)]
    left = set(range(C))
    for _ in range(C // 2):
        worst = max(sorted(left), key=lambda c: fits[c].gain, default=-1)
        if worst < 0 or fits[worst].gain < WORTH_CORRECTING:
            break
        left.remove(worst)
        changes[worst] = fits[worst].change
        for c in [*changes] * (_ALTERNATIONS if len(changes) > 1 else 0):
            fits[c] = best_fit(_corrected(s, changes, but=c), c, noise[c])
            changes[c] = fits[c].change
        given = _corrected(s, changes)
        for c in sorted(left):
            fit = best_fit(given, c, noise[c])
            close = fits[c].gain >= RIVAL_RATIO * fits[worst].gain
            if close and (fit.gain < WORTH_CORRECTING or C == 2):
                alike[c].add(worst)
                alike[worst].add(c)
                left.remove(c)
            else:
                fits[c] = fit
    return fits, alike


def _believable(s: SpanObservations, noise: Float64Array) -> SpanObservations:
    """The same without tentative persons whom no change of their camera makes fit."""
    x = s.x.copy()
    for c in np.flatnonzero(s.tentative).tolist():
        if not explains(best_fit(s, c, noise[c]), float(np.median(np.delete(noise[c], c)))):
            x[c] = np.nan
    return replace(s, x=x)


def explains(fit: Fit, promised_px: float) -> bool:
    """Whether what a fit leaves is what the calibration promises, or not much more."""
    return fit.after_px <= max(EXPLAINED_RATIO * promised_px, EXPLAINED_PX)


def _corrected(
    s: SpanObservations, changes: Mapping[int, Float64Array], *, but: int = -1
) -> SpanObservations:
    """The same as if the changes of cameras, but of one, had been known."""
    R, t, x = s.rig.R_ref_cam.copy(), s.rig.t_ref_cam.copy(), s.x.copy()
    for c, change in changes.items():
        if c != but:
            t[c] = t[c] + R[c] @ change[SHIFT]
            R[c] = R[c] @ exp_so3(change[ROTATION])
            x[c] -= change[CLOCK] * s.v[c]
    return replace(s, rig=replace(s.rig, R_ref_cam=R, t_ref_cam=t), x=x)


def best_fit(sightings: SpanObservations, c: int, noise_px: Float64Array) -> Fit:
    """A turn and a jump of the clock; a displacement, too, where that explains clearly more."""
    points = _EpipolarPoints.of(sightings, c, noise_px)
    turned = fit_change(points, _TURN_AND_CLOCK)
    promise_holds = RMS_OVER_MEDIAN * turned.before_px <= float(np.median(noise_px))
    if turned.n_points < MIN_POINTS or promise_holds:
        return turned
    moved = fit_change(points, _EVERYTHING)
    return moved if moved.gain > SHIFT_GAIN_RATIO * turned.gain + SHIFT_GAIN else turned


def fit_change(points: _EpipolarPoints, parameters: IntArray) -> Fit:
    """Fit those of the seven parameters that are named; the others are held at 0."""
    zero, none = np.zeros(7), np.zeros((7, 7))
    M, n = len(points.x), points.n
    if M < MIN_POINTS:
        return Fit(zero, none, np.nan, np.nan, 0.0, M)
    independent = n / M / CORRELATED_KEYPOINTS
    free = np.ix_(parameters, parameters)
    change, (start, J) = zero, points.residuals(zero)
    r = start
    for _ in range(_ITERATIONS):
        scale = np.maximum(points.noise, NOISE_MARGIN * RMS_OVER_MEDIAN * np.median(np.abs(r)))
        w = independent / (scale**2 + r**2)
        A = (J.T * w) @ J + np.diag(_PRIOR**-2.0)
        g = (J.T * w) @ r + change / _PRIOR**2
        step = np.zeros(7)
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
    return Fit(change, information, before, after, total, n)


_TURN_AND_CLOCK = np.array([0, 1, 2, 6])
_EVERYTHING = np.arange(7)
_CONVERGED = np.repeat([1e-4, 1e-3, 1e-4], [3, 3, 1])
"""Steps (rad, m, s) below which a fit has converged. Numerical: far below what raises an alarm."""


@dataclass(frozen=True, slots=True, eq=False)
class _EpipolarPoints:
    """Key points of one camera beside those of the same joints in the others, in its frame."""

    x: Float64Array  # (M, 3)
    v: Float64Array  # (M, 3)
    y: Float64Array  # (M, 3) direction of the other camera's ray
    t: Float64Array  # (M, 3) centre of the other camera
    R: Float64Array  # (M, 3, 3) optical frame of the other to that of this camera
    focal: Float64Array  # (M,)
    noise: Float64Array  # (M,)
    n: int  # for which the M stand

    @staticmethod
    def of(s: SpanObservations, c: int, noise_px: Float64Array) -> _EpipolarPoints:
        others = [j for j in range(len(s.names)) if j != c]
        parts = [_pair(s, c, j, float(noise_px[j])) for j in others]
        n = sum(len(part[0]) for part in parts)
        stride = max(1, -(-n // _MAX_POINTS))
        x, v, y, t, R, focal, noise = (
            np.concatenate(column)[::stride] for column in zip(*parts, strict=True)
        )
        return _EpipolarPoints(x, v, y, t, R, focal, noise, n)

    def residuals(self, change: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Signed Sampson distances (M,), px, and their derivatives (M, 7)."""
        x = (self.x - change[CLOCK] * self.v) @ exp_so3(change[ROTATION]).T
        v = self.v @ exp_so3(change[ROTATION]).T
        t = self.t - change[SHIFT]
        n = np.cross(t, self.y)
        line = np.einsum("mba,mb->ma", self.R, np.cross(x, t))
        scale = self.focal / np.sqrt(
            np.maximum((n[:, :2] ** 2).sum(-1) + (line[:, :2] ** 2).sum(-1), 1e-18)
        )
        J = np.column_stack([np.cross(x, n), np.cross(x, self.y), -(v * n).sum(-1)])
        return (x * n).sum(-1) * scale, J * scale[:, None]


def _pair(s: SpanObservations, c: int, j: int, noise_px: float) -> tuple[Float64Array, ...]:
    both = np.isfinite(s.x[c, ..., 0] + s.x[j, ..., 0] + s.v[c, ..., 0])
    x, v, other = s.x[c][both], s.v[c][both], s.x[j][both]
    R = s.rig.R_ref_cam[c].T @ s.rig.R_ref_cam[j]
    t = s.rig.R_ref_cam[c].T @ (s.rig.t_ref_cam[j] - s.rig.t_ref_cam[c])
    M = len(x)
    focal = np.sqrt(s.focal[c][both] * s.focal[j][both])
    return (
        x,
        v,
        other @ R.T,
        np.tile(t, (M, 1)),
        np.tile(R, (M, 1, 1)),
        focal,
        np.full(M, noise_px),
    )
