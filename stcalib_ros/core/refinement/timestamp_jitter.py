"""Errors of single stamps: when each image was taken, told by all joints of all people in it.

The stamps of a driver or a network are off by milliseconds, each by another amount. One unknown
for each image, with a prior whose deviation is that of the largest marginal likelihood, takes
that out. Images of different knots have nothing in common once the joints are eliminated, so
that the cost is linear in the length of the recording. Mean and trend of the errors of a camera
are not told from offset and rate of its clock, and stay with these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.istba import readjusted
from stcalib_ros.core.bundle.iteration import Iteration, TimestampErrors
from stcalib_ros.core.bundle.levenberg_marquardt import time_sums
from stcalib_ros.core.bundle.normal_equations import CAMERA
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.options import BundleOptions
from stcalib_ros.core.refinement.regular_frames import even_times

_DECISIVE = 10.0
_PASSES = 3
_RENEWALS = 30
_FIRST_STDDEV_S = 1e-3
_LEAST_STDDEV_S = 1e-5
_ALIKE = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class _Images:
    """The images of C cameras at K knots, and the rows (N,) that they are in.

    Attributes
    ----------
    time_s : (K,) ndarray
        Of the knots.
    knot : (N,) ndarray of int
        Position of each row's knot among them.
    own : (N, C) ndarray of bool
        The row shows that image; else another image of the camera at the same knot.
    stamp : (N, C) ndarray of int
        Position of the stamp of each image in the row.
    at_knot : (K, C) ndarray of int
        Position of the stamp of the image; -1 where there is none.
    """

    time_s: Float64Array
    knot: IntArray
    own: BoolArray
    stamp: IntArray
    at_knot: IntArray

    def values(self, of_stamps: Sequence[Float64Array]) -> Float64Array:
        """Values (K, C) of the images from those of all stamps of each camera."""
        columns = zip(of_stamps, self.at_knot.T, strict=True)
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
    cameras: Sequence[LiftedCamera], last: Iteration, o: BundleOptions
) -> Iteration:
    """A round adjusted with images at the times that they tell.

    The same where the images do not say decisively that stamps are off. Where they agree that
    images were taken at even times, the stamps are put there.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
    last : Iteration
    o : BundleOptions
    """
    members = [cameras[c] for c in last.rig.cameras]
    images = _images_of(members, last)
    H, g = _sums(images, last)
    none = np.zeros_like(g)
    found = _posterior(H, g, none, none)
    if not found.gain > _DECISIVE:
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
        timed = _adjusted(last, _by_row(images, correction, even), timed, o, last=n == _PASSES - 1)
    return replace(timed, stamps=_errors(images, correction, found.variance))


def _images_of(members: Sequence[LiftedCamera], last: Iteration) -> _Images:
    o = last.observations
    knots, knot = np.unique(o.knot, return_inverse=True)
    seen = o.track >= 0
    before = last.rig.offset_s - last.state.shift_s
    when = o.start_s + o.knot[:, None] * o.step_s + o.phi - before
    stamp = np.stack([_nearest(m.stamps, t) for m, t in zip(members, when.T, strict=True)], 1)
    at_knot = np.full((len(knots), len(members)), -1, dtype=np.int64)
    for c in range(len(members)):
        rows = np.flatnonzero(seen[:, c])
        order = rows[np.argsort(-np.abs(o.phi[rows, c]), kind="stable")]
        at_knot[knot[order], c] = stamp[order, c]
    own = seen & (stamp == at_knot[knot])
    return _Images(np.asarray(o.start_s + knots * o.step_s), knot, own, stamp, at_knot)


def _nearest(stamps: Float64Array, times: Float64Array) -> IntArray:
    """Position of the stamp nearest to each time."""
    after = np.clip(np.searchsorted(stamps, times), 1, len(stamps) - 1)
    nearer = times - stamps[after - 1] < stamps[after] - times
    return np.asarray(after - nearer, dtype=np.int64)


def _sums(images: _Images, last: Iteration) -> tuple[Float64Array, Float64Array]:
    used = last.state.used & images.own[:, :, None]
    state = replace(last.state, used=used)
    return time_sums(last.observations, state, images.knot)


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
    told = np.diagonal(H, axis1=1, axis2=2) > 0.0
    away = mean_s - at_s
    there = g + np.einsum("kcd,kd->kc", H, away)
    variance = np.full(g.shape[1], _FIRST_STDDEV_S**2)
    for _ in range(_RENEWALS):
        P = np.linalg.inv(H + np.diag(1.0 / variance))
        step = -np.einsum("kcd,kd->kc", P, there)
        spread = np.diagonal(P, axis1=1, axis2=2)
        taken = ((1.0 - spread / variance) * told).sum(0)
        renewed = (step**2 * told).sum(0) / np.maximum(taken, 1e-9)
        variance = np.maximum(renewed, _LEAST_STDDEV_S**2)
    root = np.sqrt(variance)
    volume = np.linalg.slogdet(np.eye(len(root)) + root[:, None] * H * root)[1].sum()
    down = 0.5 * ((there + g) * away).sum()
    gain = -down - 0.5 * (there * step).sum() - 0.5 * volume
    return _Posterior(np.where(told, mean_s + step, 0.0), spread, float(gain))


def _even(
    members: Sequence[LiftedCamera], images: _Images, correction_s: Float64Array
) -> list[Float64Array]:
    """Corrections of all stamps towards even times, of cameras whose images agree; else zero."""
    out = []
    for camera, at, found in zip(members, images.at_knot.T, correction_s.T, strict=True):
        even = even_times(camera.stamps)
        there = np.flatnonzero(at >= 0)
        a, b = even[at[there]], found[there]
        agree = float(a @ b) > _ALIKE * float(np.sqrt((a @ a) * (b @ b)))
        out.append(even if agree else np.zeros_like(even))
    return out


def _without_trend(images: _Images, correction_s: Float64Array) -> Float64Array:
    """Corrections (K, C) less the line through those of each camera."""
    out = np.zeros_like(correction_s)
    since = images.time_s - images.time_s.mean()
    for c, at in enumerate(images.at_knot.T):
        there = np.flatnonzero(at >= 0)
        A = np.stack([np.ones(len(there)), since[there]], 1)
        y = correction_s[there, c]
        out[there, c] = y - A @ np.linalg.lstsq(A, y, rcond=None)[0]
    return out


def _by_row(
    images: _Images, correction_s: Float64Array, even: Sequence[Float64Array]
) -> Float64Array:
    """Corrections (N, C) of the images in the rows."""
    other = np.stack([e[at] for e, at in zip(even, images.stamp.T, strict=True)], 1)
    return np.where(images.own, correction_s[images.knot], other)


def _adjusted(
    first: Iteration, correction_s: Float64Array, timed: Iteration, o: BundleOptions, *, last: bool
) -> Iteration:
    """The round with images at their times, adjusted from where it is."""
    seen = first.observations.track >= 0
    phi = first.observations.phi + np.where(seen, correction_s, 0.0)
    observations = replace(first.observations, phi=phi)
    return readjusted(timed, observations, o, last=last)


def _errors(images: _Images, correction_s: Float64Array, variance: Float64Array) -> TimestampErrors:
    there = images.at_knot >= 0
    n = there.sum(0)
    square = ((correction_s**2 + variance) * there).sum(0) / n
    since = (images.time_s - images.time_s.mean())[:, None] * there
    length = (since**2).sum(0) - since.sum(0) ** 2 / n
    return TimestampErrors(np.sqrt(square), square / n, square / length)


def added_covariance(last: Iteration) -> Float64Array:
    """What the mean errors of stamps add to the covariance (7 C, 7 C) of the cameras."""
    C = len(last.rig.cameras)
    out = np.zeros((CAMERA * C, CAMERA * C))
    if last.stamps is None or last.state.synchronised:
        return out
    variance = last.stamps.offset_variance
    offsets = CAMERA * np.arange(1, C) + CAMERA - 1
    out[np.ix_(offsets, offsets)] = np.diag(variance[1:]) + variance[0]
    return out
