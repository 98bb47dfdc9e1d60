"""Clock rates: what the offsets do over the recording.

Over time t the offset of a clock of rate s is ``delta + s (t - middle)``. The normal equations of
short spans of time, with every span's own t, hold those of the rates: their columns are those of
the offsets, times ``t - middle``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.iteration import ClockSkews, Iteration
from stcalib_ros.core.bundle.levenberg_marquardt import adjust, gauge, reduced_by_group
from stcalib_ros.core.bundle.normal_equations import CAMERA
from stcalib_ros.core.bundle.state import BundleState, estimate_motion
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.options import BundleOptions

MAX_STDDEV = 10e-6
_SPAN_S = 0.5
_MAX_SPANS = 120
_PASSES = 3
_SETTLED = 0.1
_TOLERANCE = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class _Spans:
    """Normal equations of the cameras, span by span, and the middle of each."""

    H: Float64Array
    g: Float64Array
    time_s: Float64Array


def with_clock_skews(last: Iteration, o: BundleOptions) -> Iteration:
    """A round with the rates of its clocks, adjusted to them where the recording tells them.

    A rate counts as told if its predicted standard deviation is at most 10 ppm: usual clocks
    differ by a few ten. Where stamps have errors of their own, the line through these is no rate
    of a clock; the images are put where they belong if they tell that better than the stamps do.
    """
    if last.state.synchronised:
        return last
    start, middle = last.observations, _middle(last)
    total = np.zeros(len(last.rig.cameras))
    stddev, told = total, total > 0.0
    trend = total if last.stamps is None else last.stamps.rate_variance
    trend = trend + trend[0]
    timed = last
    for _ in range(_PASSES):
        spans = _spans(timed, middle)
        step, own = _rates(spans, timed.state, np.ones_like(told))
        own = np.nan_to_num(own, nan=np.inf)
        stddev = np.hypot(own, np.sqrt(trend))
        told = stddev <= MAX_STDDEV
        known = told | (own**2 < trend)
        told[0] = known[0] = False
        if not known.any():
            break
        step, own = _rates(spans, timed.state, known)
        stddev = np.where(told, np.hypot(own, np.sqrt(trend)), stddev)
        if timed is not last and (np.abs(step) < _SETTLED * own)[known].all():
            break
        total = total + np.where(known, step, 0.0)
        timed = _adjusted(last, start.phi + _since(last, middle)[:, None] * total, timed, o)
    skew = np.where(told, total, 0.0)
    return replace(timed, clocks=ClockSkews(skew, _without_reference(stddev), middle))


def _without_reference(stddev: Float64Array) -> Float64Array:
    return np.concatenate([[0.0], stddev[1:]])


def _middle(last: Iteration) -> float:
    o = last.observations
    return o.start_s + 0.5 * float(o.knot.min() + o.knot.max()) * o.step_s


def _since(last: Iteration, middle_s: float) -> Float64Array:
    """Time (N,) of every row after the middle, s."""
    o = last.observations
    return np.asarray(o.start_s + o.knot * o.step_s - middle_s)


def _spans(last: Iteration, middle_s: float) -> _Spans:
    since = _since(last, middle_s)
    length = max(_SPAN_S, float(np.ptp(since)) / _MAX_SPANS)
    _, group = np.unique(np.floor(since / length), return_inverse=True)
    number: IntArray = group.ravel()
    H, g = reduced_by_group(last.observations, last.state, number)
    time = np.bincount(number, since) / np.bincount(number)
    return _Spans(H, g, time)


def _rates(spans: _Spans, state: BundleState, free: BoolArray) -> tuple[Float64Array, Float64Array]:
    """Steps (C,) of the rates from where they are, and their standard deviations.

    The deviation is the larger one of that of independent noise and of what the spans differ by.
    """
    C = len(free)
    k = CAMERA * C
    offsets = CAMERA * np.arange(C) + CAMERA - 1
    E = np.zeros((len(spans.time_s), k, k + C))
    E[:, range(k), range(k)] = 1.0
    E[:, offsets, k + np.arange(C)] = spans.time_s[:, None]
    H = np.einsum("bia,bij,bjc->ac", E, spans.H, E, optimize=True)
    scores = np.einsum("bia,bi->ba", E, spans.g, optimize=True)
    poses, scale = gauge(state.t_cam_ref)
    H[:k, :k] += 1e6 * np.diag(H)[:k].max() * np.outer(scale, scale)
    index = np.concatenate([poses, k + np.flatnonzero(free & (np.arange(C) > 0))])
    size = np.sqrt(np.maximum(np.diag(H)[index], 1e-30))
    inverse = np.linalg.pinv(H[np.ix_(index, index)] / np.outer(size, size), rcond=1e-13)
    inverse /= np.outer(size, size)
    U = scores[:, index]
    n = len(U)
    step, variance = np.zeros(k + C), np.full(k + C, np.nan)
    step[index] = -inverse @ U.sum(0)
    variance[index] = np.diag(inverse)
    if n > 2 * len(index):
        spread = inverse @ (U.T @ U) @ inverse * n / (n - len(index))
        variance[index] = np.maximum(variance[index], np.diag(spread))
    return step[k:], np.sqrt(variance[k:])


def _adjusted(last: Iteration, phi: Float64Array, timed: Iteration, o: BundleOptions) -> Iteration:
    """The round with image times by the rates, adjusted from where it is."""
    observations = replace(last.observations, phi=phi)
    V, A = estimate_motion(observations, timed.state.X, timed.state.used.sum(1) >= 2)
    state = replace(timed.state, V=V, A=A)
    state = adjust(observations, state, iterations=o.max_iterations, tolerance=_TOLERANCE)
    return timed.moved(observations, state)
