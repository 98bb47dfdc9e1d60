"""Timestamp jitter: when each image was taken, by all joints of all people in it.

The timestamps of a driver or a network are off by milliseconds, each by another amount. One unknown
for each image, with a Gaussian prior whose variance is that of the largest marginal likelihood,
compensates that. Images of different time bins have nothing in common once the joints are
eliminated, so that the cost is linear in the length of the recording. Mean and trend of the errors
of a camera cannot be separated from offset and skew of its clock, and stay with these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.istba import readjusted
from stcalib_ros.core.bundle.iteration import Iteration, TimestampErrors
from stcalib_ros.core.bundle.levenberg_marquardt import time_sums
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.parameters import CLOCK_SKEW, TIME_OFFSET, ParameterLayout
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.options import BundleOptions
from stcalib_ros.core.refinement.evidence import renewed_variance
from stcalib_ros.core.refinement.limits import MIN_EVEN_CORRELATION, MIN_LOG_EVIDENCE
from stcalib_ros.core.refinement.regular_frames import regular_times

_PASSES = 3
"""Count. Corrections of the timestamps, each with a new adjustment. Numerical."""

_RENEWALS = 30
"""Count. Steps of the fixed point of the variances. Numerical."""

_FIRST_STDDEV_S = 1e-3
"""Seconds. Standard deviation of the jitter to start from. Numerical: the evidence decides."""

_LEAST_STDDEV_S = 1e-5
"""Seconds. Smallest standard deviation of the jitter. Numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class _TimedImages:
    """The images of C cameras at K time bins, and the rows (N,) that they are in.

    Attributes
    ----------
    time_s : (K,) ndarray
        Times of the time bins, s.
    time_bin : (N,) ndarray of int
        Position of each row's time bin among them.
    own : (N, C) ndarray of bool
        The row shows that image; else another image of the camera at the same time bin.
    stamp : (N, C) ndarray of int
        Position of the stamp of each image in the row.
    at_bin : (K, C) ndarray of int
        Position of the stamp of the image; -1 where there is none.
    """

    time_s: Float64Array
    time_bin: IntArray
    own: BoolArray
    stamp: IntArray
    at_bin: IntArray

    def values(self, of_stamps: Sequence[Float64Array]) -> Float64Array:
        """Values (K, C) of the images from those of all stamps of each camera."""
        columns = zip(of_stamps, self.at_bin.T, strict=True)
        return np.stack([np.where(at >= 0, value[at], 0.0) for value, at in columns], 1)


@dataclass(frozen=True, slots=True, eq=False)
class _Posterior:
    """Errors of the stamps (K, C) by their images, with a prior about some mean.

    Attributes
    ----------
    correction_s : (K, C) ndarray
        What to add to each stamp.
    variance : (K, C) ndarray
    gain : float
        Logarithm of the likelihood, against no errors at the start of the pass.
    """

    correction_s: Float64Array
    variance: Float64Array
    gain: float


def with_timestamp_errors(
    cameras: Sequence[LiftedCamera],
    last: Iteration,
    options: BundleOptions,
    layout: ParameterLayout | None = None,
) -> Iteration:
    """Adjust a round to timestamps that are corrected image by image.

    The same where the evidence for jitter is not decisive. Where the keypoints agree that images
    were taken at regular times, timestamps start from these.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
    last : Iteration
    options : BundleOptions
    layout : ParameterLayout, optional
        Unknowns of the cameras; default: poses and time offsets.
    """
    members = [cameras[c] for c in last.rig.cameras]
    images = _images_of(members, last)
    H, g = _sums(images, last)
    none = np.zeros_like(g)
    found = _posterior(H, g, none, none)
    if not found.gain > MIN_LOG_EVIDENCE:
        return last
    even = _even(members, images, found.correction_s)
    mean = images.values(even)
    timed, correction = last, none
    for n in range(_PASSES):
        if n > 0:
            H, g = _sums(images, timed)
        found = max(
            (_posterior(H, g, correction, m) for m in (mean, none)), key=lambda one: one.gain
        )
        correction = _without_trend(images, found.correction_s)
        obs = _corrected(last.observations, _by_row(images, correction, even))
        timed = readjusted(timed, obs, options, last=n == _PASSES - 1, layout=layout)
    return replace(timed, timestamp_errors=_errors(images, correction, found.variance))


def _images_of(members: Sequence[LiftedCamera], last: Iteration) -> _TimedImages:
    obs = last.observations
    time_bins, time_bin = np.unique(obs.time_bin, return_inverse=True)
    seen = obs.track >= 0
    before = last.rig.offset_s - last.state.shift_s
    when = obs.start_s + obs.time_bin[:, None] * obs.step_s + obs.phi - before
    stamp = np.stack([_nearest(m.stamps, t) for m, t in zip(members, when.T, strict=True)], 1)
    at_bin = np.full((len(time_bins), len(members)), -1, dtype=np.int64)
    for c in range(len(members)):
        rows = np.flatnonzero(seen[:, c])
        order = rows[np.argsort(-np.abs(obs.phi[rows, c]), kind="stable")]
        at_bin[time_bin[order], c] = stamp[order, c]
    own = seen & (stamp == at_bin[time_bin])
    return _TimedImages(
        np.asarray(obs.start_s + time_bins * obs.step_s), time_bin, own, stamp, at_bin
    )


def _nearest(stamps: Float64Array, times: Float64Array) -> IntArray:
    """Position of the stamp nearest to each time."""
    after = np.clip(np.searchsorted(stamps, times), 1, len(stamps) - 1)
    nearer = times - stamps[after - 1] < stamps[after] - times
    return np.asarray(after - nearer, dtype=np.int64)


def _sums(images: _TimedImages, last: Iteration) -> tuple[Float64Array, Float64Array]:
    used = last.state.inlier & images.own[:, :, None]
    state = replace(last.state, inlier=used)
    return time_sums(last.observations, state, images.time_bin)


def _posterior(
    H: Float64Array, g: Float64Array, at_s: Float64Array, mean_s: Float64Array
) -> _Posterior:
    """Most likely errors, the variances of the prior by MacKay's fixed point.

    Parameters
    ----------
    H, g : ndarray
        Normal equations at corrections `at_s` (K, C), as `stba.time_sums` gives them.
    at_s, mean_s : (K, C) ndarray
        Corrections there, and the mean of the prior.
    """
    observed = np.diagonal(H, axis1=1, axis2=2) > 0.0
    difference = mean_s - at_s
    there = g + np.einsum("kcd,kd->kc", H, difference)
    variance = np.full(g.shape[1], _FIRST_STDDEV_S**2)
    for _ in range(_RENEWALS):
        P = np.linalg.inv(H + np.diag(1.0 / variance))
        step = -np.einsum("kcd,kd->kc", P, there)
        posterior = np.diagonal(P, axis1=1, axis2=2)
        determined = ((1.0 - posterior / variance) * observed).sum(0)
        variance = renewed_variance((step**2 * observed).sum(0), determined, _LEAST_STDDEV_S**2)
    root = np.sqrt(variance)
    volume = np.linalg.slogdet(np.eye(len(root)) + root[:, None] * H * root)[1].sum()
    down = 0.5 * ((there + g) * difference).sum()
    gain = -down - 0.5 * (there * step).sum() - 0.5 * volume
    return _Posterior(np.where(observed, mean_s + step, 0.0), posterior, float(gain))


def _even(
    members: Sequence[LiftedCamera], images: _TimedImages, correction_s: Float64Array
) -> list[Float64Array]:
    """Corrections of all stamps towards even times, of cameras whose images agree; else zero."""
    out = []
    for camera, at, found in zip(members, images.at_bin.T, correction_s.T, strict=True):
        even = regular_times(camera.stamps)
        there = np.flatnonzero(at >= 0)
        a, b = even[at[there]], found[there]
        agree = float(a @ b) > MIN_EVEN_CORRELATION * float(np.sqrt((a @ a) * (b @ b)))
        out.append(even if agree else np.zeros_like(even))
    return out


def _without_trend(images: _TimedImages, correction_s: Float64Array) -> Float64Array:
    """Corrections (K, C) less the line through those of each camera."""
    out = np.zeros_like(correction_s)
    since = images.time_s - images.time_s.mean()
    for c, at in enumerate(images.at_bin.T):
        there = np.flatnonzero(at >= 0)
        A = np.stack([np.ones(len(there)), since[there]], 1)
        y = correction_s[there, c]
        out[there, c] = y - A @ np.linalg.lstsq(A, y, rcond=None)[0]
    return out


def _by_row(
    images: _TimedImages, correction_s: Float64Array, even: Sequence[Float64Array]
) -> Float64Array:
    """Corrections (N, C) of the images in the rows."""
    other = np.stack([e[at] for e, at in zip(even, images.stamp.T, strict=True)], 1)
    return np.where(images.own, correction_s[images.time_bin], other)


def _corrected(obs: Observations, correction_s: Float64Array) -> Observations:
    """Observations with images at corrected times (N, C)."""
    return replace(obs, phi=obs.phi + np.where(obs.track >= 0, correction_s, 0.0))


def _errors(
    images: _TimedImages, correction_s: Float64Array, variance: Float64Array
) -> TimestampErrors:
    there = images.at_bin >= 0
    n = there.sum(0)
    square = ((correction_s**2 + variance) * there).sum(0) / n
    since = (images.time_s - images.time_s.mean())[:, None] * there
    length = (since**2).sum(0) - since.sum(0) ** 2 / n
    return TimestampErrors(np.sqrt(square), square / n, square / length)


def added_covariance(errors: TimestampErrors | None, layout: ParameterLayout) -> Float64Array:
    """Additional covariance (n, n) due to the mean and the trend of the errors of timestamps."""
    out = np.zeros((layout.size, layout.size))
    if errors is None or layout.synchronised:
        return out
    free = layout.free()
    for unknown, variance in (
        (TIME_OFFSET, errors.offset_variance),
        (CLOCK_SKEW, errors.skew_variance),
    ):
        if unknown in layout.unknowns:
            columns = layout.scalars(unknown)
            own = np.isin(columns, free)
            rows = columns[own]
            out[np.ix_(rows, rows)] = np.diag(variance[own]) + variance[0]
    return out
