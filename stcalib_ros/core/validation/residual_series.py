"""How the residuals of each camera change with time: as a rotation and a clock correction of it.

For every camera and window of time, the small change of that camera alone is fitted that best
explains the epipolar distances to all others, which are held. A camera whose pose and clock stay
the same has the same change in all windows. The keypoints and the stamps are those of the input:
what refinement made of them, such as corrections of single stamps, may have absorbed a change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.motion_filter import depth_variance_ratio
from stcalib_ros.core.bundle.observations import Observations, observe
from stcalib_ros.core.bundle.parameters import CLOCK_SKEW
from stcalib_ros.core.bundle.state import person_rows_of
from stcalib_ros.core.geometry.local_polynomial import smooth_motion
from stcalib_ros.core.geometry.robust import NOISE_MARGIN, RMS_OVER_MEDIAN
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.validation.continued_tracks import with_tracks_continued
from stcalib_ros.core.validation.thresholds import (
    MAX_FIT_PX,
    MAX_FIT_RATIO,
    UNEXPLAINED_PX,
    UNEXPLAINED_RATIO,
)

ROTATION, CLOCK = slice(0, 3), slice(3, 4)
"""Positions of the parameters of a change: rotation vector (rad), correction of the clock (s)."""

_JOINTS = 8
"""Joints of a person that are compared, about. Numerical: neighbours move together."""

_WINDOW_S, _N_WINDOWS = (0.5, 1.0), 10
"""Seconds, and count. Windows are a tenth of a clip, within these lengths: a second is about one
step of a walking person, so that a clock shows; half a second has some of it. Chosen."""

_MAX_WINDOWS = 120
"""Count. Windows of recordings of more than two minutes are longer. Bounds cost and memory, which
grow with the square of the number of windows."""

_POINTS_PER_WINDOW = 250
"""Pairs of keypoints of a camera in a window, count; of more, a regular part is used. Cost alone:
joints of one body share their errors."""

_LEAST_POINTS = 40
"""Pairs of keypoints, count, below which a window says nothing: two or three bodies at one moment.
As in the monitoring of a calibration in force, where it was chosen."""

_USUAL = 0.25
"""Fraction. Quantile of the residuals of all windows that counts as the usual one: at most three
quarters of a recording may not fit. Chosen."""

_HALF_WINDOW_S = 0.2
"""Seconds. Half window of the cubics that image velocities are read from: as in the adjustment."""

_MIN_HALF_WINDOW = 3
"""Time bins. Shortest such window: four values determine a cubic. Numerical."""

_ITERATIONS = 6
"""Gauss-Newton steps of the fits of all windows. Numerical: 20 degrees converge in five."""

_LARGEST_TURN, _WEAK_DEPTHS = 0.35, 50.0
"""Radians, and ratio of variances along and across the rays. Of cameras beside each other a window
that a larger turn would explain says nothing: they agree at any. Measured in a row of cameras that
stand still, 30 cm apart: 0.8 and 1.4; ratios as in `_MAX_DEPTH_RATIO` of pairs."""

_LEAST_SCALE_PX = 1.0
"""Pixels. Least scale of the robust weights: keypoints are never better. Numerical."""

_PRIOR_STDDEV = np.array([0.3, 0.3, 0.3, 0.5])
"""Standard deviations of a change (rad, s), in weight as one keypoint at the noise: it only keeps
what a window does not determine from running away. Numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class ChangeSeries:
    """The change that best explains the residuals of one camera, window by window.

    Attributes
    ----------
    time_s : (K,) ndarray
        Middle of each window, seconds by the reference clock; windows that say nothing are left
        out.
    change : (K, 4) ndarray
        Rotation vector in the optical frame (rad), and what to add to the time offset (s).
    information : (K, 4, 4) ndarray
        Normal equations of the change, residuals in units of their scale: as if the errors of all
        keypoints were independent.
    n_points : (K,) ndarray of int
        Number of keypoints that these are of.
    unexplained_s : (U,) ndarray
        Middle of the windows whose residuals no small change explains.
    unexplained_px : (U,) ndarray
        Median residuals that are left there, px.
    window_s : float
        Length of a window.
    """

    time_s: Float64Array
    change: Float64Array
    information: Float64Array
    n_points: IntArray
    unexplained_s: Float64Array
    unexplained_px: Float64Array
    window_s: float


@dataclass(frozen=True, slots=True, eq=False)
class ResidualSource:
    """Keypoints of all cameras of a rig, by time bin, camera and joint: what residuals are made of.

    Attributes
    ----------
    rig : Rig
    x, v : (N, C, J, 2) ndarray
        On the plane z = 1 at the times of the bins, and the change per second; NaN where not
        observed.
    focal : (N, C, J) ndarray
        Pixels per unit.
    window : (N,) ndarray of int
        Window of time of each row.
    start_s, window_s : float
        Begin of the first window, and length of all.
    noise_px : float
        Usual error of a keypoint, px.
    largest_turn : float
        Turn of a window, rad, from which on it says nothing.
    """

    rig: Rig
    x: Float64Array
    v: Float64Array
    focal: Float64Array
    window: IntArray
    start_s: float
    window_s: float
    noise_px: float
    largest_turn: float

    @staticmethod
    def of(cameras: Sequence[LiftedCamera], last: Iteration) -> ResidualSource:
        """Take the keypoints of the input, of all persons that were associated at some time.

        Parameters
        ----------
        cameras : sequence of LiftedCamera
            All cameras.
        last : Iteration
        """
        association = with_tracks_continued(last.association)
        before = replace(last.rig, offset_s=last.rig.offset_s - last.state.shift_s)
        obs = observe(cameras, before, association, step_s=last.observations.step_s)
        obs = obs.thinned_joints(max(1, round(obs.x.shape[2] / _JOINTS)))
        v = _velocities(obs)
        late = obs.elapsed() + _delays(obs, last)
        x = np.where(obs.observed[..., None], obs.x - late[..., None] * v, np.nan)
        times = obs.start_s + obs.time_bin * obs.step_s
        start, length = float(times.min()), float(np.ptp(times))
        window_s = max(float(np.clip(length / _N_WINDOWS, *_WINDOW_S)), length / _MAX_WINDOWS)
        n = max(1, round(length / window_s))
        window = np.minimum(((times - start) / window_s).astype(np.int64), n - 1)
        focal, noise_px = obs.focal.astype(np.float64), max(_LEAST_SCALE_PX, last.median_px)
        is_weak = depth_variance_ratio(last.observations, last.state) > _WEAK_DEPTHS
        largest = _LARGEST_TURN if is_weak else np.inf
        return ResidualSource(last.rig, x, v, focal, window, start, window_s, noise_px, largest)

    def series(self, c: int) -> ChangeSeries:
        """Fit the change of camera c in all windows of time."""
        n = int(self.window.max(initial=-1)) + 1
        times = np.asarray(self.start_s + (np.arange(n) + 0.5) * self.window_s)
        points = _KeypointPairs.of(self, c)
        return _series(points, times, self.window_s, self.noise_px, self.largest_turn)

    def corrected(self, c: int, series: ChangeSeries) -> ResidualSource:
        """The same with the change of camera c undone in all windows of a series."""
        change = np.zeros((int(self.window.max(initial=-1)) + 1, 4))
        at = ((series.time_s - self.start_s) / self.window_s).astype(np.int64)
        change[at] = series.change
        own = change[self.window][:, None]
        late = np.insert(self.x[:, c] - own[..., CLOCK] * self.v[:, c], 2, 1.0, axis=-1)
        turned = late @ np.swapaxes(exp_so3(own[:, 0, ROTATION]), -1, -2)
        x = self.x.copy()
        x[:, c] = turned[..., :2] / turned[..., 2:]
        return replace(self, x=x)


def _delays(obs: Observations, last: Iteration) -> Float64Array:
    """Delays of the points (N, C, J) by the clocks that are published.

    Trends of stamps that are too uncertain to be published are no part of them.
    """
    cameras, skews = last.state.cameras, last.clock_skews
    published = {} if skews is None else {CLOCK_SKEW: skews.skew}
    known = replace(cameras, further={**cameras.further, **published})
    return known.delay(replace(obs, middle_s=last.observations.middle_s).point_times())


def _velocities(obs: Observations) -> Float64Array:
    """Change of the keypoints (N, C, J, 2) per second; 0 where nothing near is observed."""
    out = np.zeros(obs.x.shape)
    half_window = max(_MIN_HALF_WINDOW, round(_HALF_WINDOW_S / obs.step_s))
    for rows in person_rows_of(obs):
        bins = obs.time_bin[rows] - obs.time_bin[rows][0]
        n = int(bins[-1]) + 1
        for c in np.flatnonzero(obs.observed[rows].any((0, 2))):
            path, there = np.zeros((n, *obs.x.shape[2:])), np.zeros((n, obs.x.shape[2]), bool)
            path[bins], there[bins] = obs.x[rows, c], obs.observed[rows, c]
            per_step, _ = smooth_motion(path, there, half_window=half_window)
            out[rows, c] = per_step[bins] / obs.step_s
    return out


@dataclass(frozen=True, slots=True, eq=False)
class _KeypointPairs:
    """Keypoints of one camera, each with that of the same joint in another, ordered by window."""

    x: Float64Array  # (M, 3) on the plane z = 1
    v: Float64Array  # (M, 3) its time derivative, per second
    normal: Float64Array  # (M, 3) of the epipolar plane of the other keypoint, in this camera
    t: Float64Array  # (M, 3) centre of the other camera, in the frame of this one
    R: Float64Array  # (M, 3, 3) R_cam_other
    focal: Float64Array  # (M,) px
    window: IntArray  # (M,)

    @staticmethod
    def of(seen: ResidualSource, c: int) -> _KeypointPairs:
        """Pair the keypoints of camera c with those of all others."""
        present = np.isfinite(seen.x[..., 0])
        parts = [_pair(seen, present, c, j) for j in range(present.shape[1]) if j != c]
        columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
        window = columns[-1]
        n = int(seen.window.max(initial=-1)) + 1
        order = np.argsort(window, kind="stable")[
            :: max(1, len(window) // (_POINTS_PER_WINDOW * n))
        ]
        return _KeypointPairs(*(column[order] for column in columns))

    def residuals(self, change: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return signed Sampson distances (M,), px, and their derivatives (M, 4).

        The scale of the distance is held in the derivative: exact where the residual is 0.

        Parameters
        ----------
        change : (K, 4) ndarray
            Of each window.
        """
        own = change[self.window]
        turned = exp_so3(change[:, ROTATION])[self.window]
        x = np.einsum("mab,mb->ma", turned, self.x - own[:, CLOCK] * self.v)
        v = np.einsum("mab,mb->ma", turned, self.v)
        line = np.einsum("mba,mb->ma", self.R, np.cross(x, self.t))
        steep = (self.normal[:, :2] ** 2).sum(-1) + (line[:, :2] ** 2).sum(-1)
        scale = self.focal / np.sqrt(np.maximum(steep, 1e-18))
        J = np.column_stack([np.cross(x, self.normal), -(v * self.normal).sum(-1)])
        return (x * self.normal).sum(-1) * scale, J * scale[:, None]


def _pair(seen: ResidualSource, present: BoolArray, c: int, j: int) -> tuple[Any, ...]:
    """Return the arrays of `_KeypointPairs` that cameras c and j have in common."""
    rig = seen.rig
    row, joint = np.nonzero(present[:, c] & present[:, j])
    R = rig.R_ref_cam[c].T @ rig.R_ref_cam[j]
    t = rig.R_ref_cam[c].T @ (rig.t_ref_cam[j] - rig.t_ref_cam[c])
    x, other = (np.insert(seen.x[row, i, joint], 2, 1.0, axis=-1) for i in (c, j))
    v = np.insert(seen.v[row, c, joint], 2, 0.0, axis=-1)
    focal = np.sqrt(seen.focal[row, c, joint] * seen.focal[row, j, joint])
    M = len(row)
    normal, centres = np.cross(t, other @ R.T), np.tile(t, (M, 1))
    return x, v, normal, centres, np.tile(R, (M, 1, 1)), focal, seen.window[row]


def _series(
    points: _KeypointPairs,
    times: Float64Array,
    window_s: float,
    noise_px: float,
    largest_turn: float,
) -> ChangeSeries:
    """Fit the changes of all windows by robust Gauss-Newton."""
    K = len(times)
    edges = np.searchsorted(points.window, np.arange(K + 1))
    change, prior = np.zeros((K, 4)), np.diag(_PRIOR_STDDEV**-2.0) / noise_px**2
    information, typical = np.zeros((K, 4, 4)), np.zeros(K)
    for _ in range(_ITERATIONS):
        r, J = points.residuals(change)
        typical = _medians(np.abs(r), edges)
        scale = np.maximum(noise_px, NOISE_MARGIN * RMS_OVER_MEDIAN * typical)
        w = 1.0 / (scale[points.window] ** 2 + r**2)
        information = _sums(J[:, :, None] * (J * w[:, None])[:, None], edges)
        g = _sums(J * (w * r)[:, None], edges) + change @ prior
        change = change - np.linalg.solve(information + prior, g[..., None])[..., 0]
    enough = np.diff(edges) >= _LEAST_POINTS
    usual = float(np.quantile(typical[enough], _USUAL)) if enough.any() else 0.0
    fits = typical <= max(MAX_FIT_PX, MAX_FIT_RATIO * usual)
    known = enough & fits & (np.linalg.norm(change[:, ROTATION], axis=-1) < largest_turn)
    lost = enough & (typical > max(UNEXPLAINED_PX, UNEXPLAINED_RATIO * usual))
    return ChangeSeries(
        *(times[known], change[known], (information + prior)[known], np.diff(edges)[known]),
        *(times[lost], typical[lost], window_s),
    )


def _medians(values: Float64Array, edges: IntArray) -> Float64Array:
    """Medians (K,) of values (M,) between edges (K + 1,); 0 where there are none."""
    return np.array([np.median(values[a:b]) if b > a else 0.0 for a, b in pairwise(edges)])


def _sums(values: Float64Array, edges: IntArray) -> Float64Array:
    """Sums (K, ...) of values (M, ...) between edges (K + 1,)."""
    total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    return np.asarray(total[edges[1:]] - total[edges[:-1]])
