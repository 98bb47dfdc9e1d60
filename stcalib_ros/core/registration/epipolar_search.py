"""Search for the lags, persons and essential matrices that explain the keypoints of two cameras.

Every pair of tracks has an error at every lag (`epipolar_correlation`). The lags at which it is
least are seeds; a seed takes in the further pairs of tracks that its essential matrix explains at
its lag, and the evidence of all of them is summed up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.geometry.robust import median_of_known
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.options import RegistrationOptions
from stcalib_ros.core.registration.epipolar_correlation import (
    ONE,
    KeypointMoments,
    best_essential,
    correlate,
    mean_square,
    moments_at,
    pencil,
    screening_distance,
)
from stcalib_ros.core.registration.limits import (
    GROWTH_FACTOR,
    GROWTH_PX,
    JOINT_PX,
    KEYPOINT_SCALE_PX,
    MIN_GROWTH_POINTS,
    MIN_SEED_POINTS,
    SAME_LAG,
    SCAN_STEP_S,
    TYPICAL_JOINTS,
)

_BEST_KNOWN_PX = 2.0
"""Pixels. Errors below it do not make a seed better. Numerical: about the noise of keypoints."""
_LEAST_USUAL_PX = 1.0
"""Pixels. Usual error of a pair of tracks, at least. Numerical: keeps logarithms finite."""
_LARGEST_SHIFT = 0.7
"""Samples. The minimum of a parabola through three lags is no further from the middle one.
Numerical: half a sample, and a margin for noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """Pairs of tracks that one essential matrix explains at one lag.

    Attributes
    ----------
    lag : float
        Sample k of camera a is of the time of sample k + lag of camera b.
    matches : tuple of (int, int)
        Tracks of a and of b.
    E : (3, 3) ndarray
        ``x_a^T E x_b = 0``; not projected to an essential matrix.
    points : float
        Common points, count.
    error_px : float
        Root mean square Sampson distance.
    """

    lag: float
    matches: tuple[tuple[int, int], ...]
    E: Float64Array
    points: float
    error_px: float

    @property
    def support(self) -> float:
        """Common points, discounted by their error."""
        return self.points / (1.0 + (self.error_px / KEYPOINT_SCALE_PX) ** 2)


def search(
    a: KeypointMoments,
    b: KeypointMoments,
    *,
    max_lag: int,
    step_s: float,
    options: RegistrationOptions,
) -> tuple[Agreement, ...]:
    """Find the best supported agreements of two cameras that differ.

    Parameters
    ----------
    a, b : KeypointMoments
        Of both cameras, on one grid.
    max_lag : int
        Lags are searched within plus and minus this many samples.
    step_s : float
        Step of the grid, seconds.
    options : RegistrationOptions
    """
    if not a.values or not b.values:
        return ()
    pair = _Pair(a, b, max_lag, options)
    every = max(1, round(SCAN_STEP_S / step_s)) if max_lag else 1
    grown: list[Agreement] = []
    for p, q, lag in _seeds(pair, every):
        if len(grown) == options.n_candidates:
            break
        best = pair.best_lag(p, q, lag, every - 1)
        if not any(abs(g.lag - best) <= 1 and (p, q) in g.matches for g in grown):
            grown.append(pair.grow(p, q, best))
    return tuple(pair.between_samples(g) for g in _distinct(grown)[: options.n_refined])


def by_other_lenses(found: Agreement, a: KeypointMoments, b: KeypointMoments) -> Agreement:
    """Return an agreement with the matrix and the error that it has by other lenses.

    Parameters
    ----------
    found : Agreement
    a, b : KeypointMoments
        Of the same tracks by these lenses.
    """
    lag = round(found.lag)
    c = np.asarray(sum(moments_at(a, b, p, q, lag) for p, q in found.matches))
    squares, E = best_essential(*pencil(c))
    error_px = float(np.sqrt(squares[0] * a.focal_px * b.focal_px))
    return replace(found, E=E, points=float(c[ONE, ONE]), error_px=error_px)


def _seeds(pair: _Pair, every: int) -> list[tuple[int, int, int]]:
    """Tracks p and q and the lag of the least errors, by what they gain on the usual error."""
    max_lag = pair.max_lag // every
    error, points = _scan(
        pair.a.thinned(every), pair.b.thinned(every), max_lag, pair.min_points / every
    )
    error *= pair.focal_px
    known = np.isfinite(error)
    usual = median_of_known(error)
    best = np.where(known, np.maximum(error, _BEST_KNOWN_PX), np.inf)
    p, q, k = np.nonzero(known & _local_minima(error))
    if error.shape[-1] == 1:
        gain = points[p, q, k] / best[p, q, k]
    else:
        usual = np.maximum(usual[p, q], _LEAST_USUAL_PX)
        gain = points[p, q, k] * np.log(usual / best[p, q, k])
    order = np.argsort(-gain, kind="stable")
    return [(int(p[i]), int(q[i]), (int(k[i]) - max_lag) * every) for i in order]


def _scan(
    a: KeypointMoments, b: KeypointMoments, max_lag: int, min_points: float
) -> tuple[Float64Array, Float64Array]:
    """Errors (P, Q, L) of all pairs of tracks at all lags, inf where unknown, and common points."""
    shape = (len(a.values), len(b.values), 2 * max_lag + 1)
    points = np.zeros(shape)
    error = np.full(shape, np.inf)
    for p, c in correlate(a, b, max_lag=max_lag):
        points[p] = np.rint(c[..., ONE, ONE])
        enough = points[p] >= min_points
        if enough.any():
            error[p][enough] = np.sqrt(screening_distance(*pencil(c[enough])))
    return error, points


def _local_minima(error: Float64Array) -> BoolArray:
    """Where no neighbour along the last axis is less."""
    padded = np.pad(error, [(0, 0)] * (error.ndim - 1) + [(1, 1)], constant_values=np.inf)
    return np.asarray((error <= padded[..., :-2]) & (error <= padded[..., 2:]))


def _distinct(grown: Sequence[Agreement]) -> list[Agreement]:
    """Drop agreements on mostly the same tracks at nearly the lag of a better one."""
    kept: list[Agreement] = []
    for one in sorted(grown, key=lambda g: -g.support):
        same = (
            len(set(one.matches) & set(other.matches))
            > 0.5 * min(len(one.matches), len(other.matches))
            for other in kept
            if abs(one.lag - other.lag) < SAME_LAG
        )
        if not any(same):
            kept.append(one)
    return kept


class _Pair:
    """Two cameras, to look at single lags."""

    def __init__(
        self, a: KeypointMoments, b: KeypointMoments, max_lag: int, options: RegistrationOptions
    ) -> None:
        self.a, self.b, self.max_lag = a, b, max_lag
        self.focal_px = float(np.sqrt(a.focal_px * b.focal_px))
        self.min_points = max(MIN_SEED_POINTS, options.min_overlap * TYPICAL_JOINTS)
        self.overlap_a, self.overlap_b = _simultaneous(a), _simultaneous(b)

    def sums(self, matches: Sequence[tuple[int, int]], lag: int) -> Float64Array:
        """Return the sums (6, 6) of some pairs of tracks at a lag."""
        return np.asarray(sum(moments_at(self.a, self.b, p, q, lag) for p, q in matches))

    def best_lag(self, p: int, q: int, near: int, reach: int) -> int:
        """Return the lag of the least error of two tracks, near one that is known coarsely."""
        lags = range(max(near - reach, -self.max_lag), min(near + reach, self.max_lag) + 1)
        c = np.stack([moments_at(self.a, self.b, p, q, lag) for lag in lags])
        usable = c[:, ONE, ONE] >= self.min_points
        if not usable.any():
            return near
        squares = np.full(len(c), np.inf)
        squares[usable] = best_essential(*pencil(c[usable]))[0][:, 0]
        return lags[int(squares.argmin())]

    def grow(self, p: int, q: int, lag: int) -> Agreement:
        """Take in what the essential matrix of two tracks explains at their lag, nearest first."""
        c = self.sums([(p, q)], lag)
        squares, E = best_essential(*pencil(c))
        matches = [(p, q)]
        others, their_c = self._candidates(lag, (p, q))
        M, N = pencil(their_c)
        free = np.arange(len(others))
        while len(free):
            limit = max(GROWTH_PX, GROWTH_FACTOR * float(np.sqrt(squares[0])) * self.focal_px)
            nearest = self._nearest(E, c, M[free], N[free], their_c[free], limit)
            if nearest is None:
                break
            k = int(free[nearest])
            matches.append((int(others[k, 0]), int(others[k, 1])))
            c = c + their_c[k]
            squares, E = best_essential(*pencil(c))
            free = free[~self._excluded(others[free], matches[-1])]
        return self._agreement(float(lag), matches, c, squares, E)

    def _nearest(
        self,
        E: Float64Array,
        c: Float64Array,
        M: Float64Array,
        N: Float64Array,
        their_c: Float64Array,
        limit: float,
    ) -> int | None:
        """Return the nearest of further pairs of tracks (K,) that are within a limit, px.

        Under the matrix so far; where none is near, under the matrix of both together: few
        keypoints of one person do not determine it.
        """
        error = np.sqrt(mean_square(E, M, N)) * self.focal_px
        if error.min() < limit:
            return int(error.argmin())
        squares, together = best_essential(*pencil(c + their_c))
        own = np.sqrt(mean_square(together, M, N)) * self.focal_px
        joint = np.sqrt(squares[:, 0]) * self.focal_px
        near = np.where(own < limit, joint, np.inf)
        return int(near.argmin()) if near.min() < JOINT_PX else None

    def between_samples(self, found: Agreement) -> Agreement:
        """Move the lag to the minimum of a parabola through the errors beside it."""
        lag = int(found.lag)
        if not abs(lag) < self.max_lag:
            return found
        c = np.stack([self.sums(found.matches, lag + d) for d in (-1, 0, 1)])
        if (c[:, ONE, ONE] < self.min_points).any():
            return found
        squares, E = best_essential(*pencil(c))
        before, here, after = squares[:, 0]
        curvature = before - 2.0 * here + after
        if not curvature > 0.0:
            return found
        shift = np.clip(0.5 * (before - after) / curvature, -_LARGEST_SHIFT, _LARGEST_SHIFT)
        return self._agreement(lag + float(shift), found.matches, c[1], squares[1], E[1])

    def _agreement(
        self,
        lag: float,
        matches: Sequence[tuple[int, int]],
        c: Float64Array,
        squares: Float64Array,
        E: Float64Array,
    ) -> Agreement:
        error_px = float(np.sqrt(squares[0])) * self.focal_px
        return Agreement(lag, tuple(matches), E, float(c[ONE, ONE]), error_px)

    def _candidates(self, lag: int, seed: tuple[int, int]) -> tuple[IntArray, Float64Array]:
        """Pairs of tracks (K, 2) that have enough points in common at a lag, and their sums."""
        begin = np.maximum(self.a.first[:, None], self.b.first - lag)
        end = np.minimum(self.a.end[:, None], self.b.end - lag)
        joints = self.a.values[0].shape[-1]
        pairs = np.argwhere((end - begin) * joints >= MIN_GROWTH_POINTS)
        pairs = pairs[~self._excluded(pairs, seed)]
        sums = [moments_at(self.a, self.b, int(p), int(q), lag) for p, q in pairs]
        c = np.array(sums).reshape(-1, 6, 6)
        enough = c[:, ONE, ONE] >= MIN_GROWTH_POINTS
        return pairs[enough], c[enough]

    def _excluded(self, pairs: IntArray, match: tuple[int, int]) -> BoolArray:
        """Pairs (K,) with a track of a match that is somebody else at that time already."""
        (p, q), (i, j) = pairs.T, match
        taken: BoolArray = (p == i) & self.overlap_b[j][q]
        taken |= (q == j) & self.overlap_a[i][p]
        return taken


def _simultaneous(tracks: KeypointMoments) -> BoolArray:
    """Pairs of tracks (P, P) that are observed at one time."""
    common = np.minimum(tracks.end[:, None], tracks.end) - np.maximum(
        tracks.first[:, None], tracks.first
    )
    return np.asarray(common > 0)
