"""Voting for the rotation, lag and matches of a pair of cameras (Sections III-B to III-D).

Every pair of tracks at every lag proposes a rotation; the proposals that other tracks agree with
survive. Several are kept, since similar motions of different people can be resolved only in the
multi-view problem.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stcalib_ros.core.geometry.alignment import best_rotation, best_rotation_trace
from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.options import RegistrationOptions
from stcalib_ros.core.registration.correlation import PairCovariance, cross_covariance
from stcalib_ros.core.registration.limits import (
    BODY_SIZE_RATIO,
    MAX_POSITION_DIFFERENCE,
    SAME_LAG,
    SAME_ROTATION,
    VOTE_THRESHOLDS,
)
from stcalib_ros.core.registration.resampling import GridTracks

_LAG_REFIT = 4
"""Samples around the lag of a proposal that are tried after a vote. Numerical: bounds the cost."""
_MAX_MEDIAN_SAMPLES = 96
"""Samples of a match by which its translation is measured, at most. Numerical: bounds the cost."""
_BLOCK_VALUES = 4_000_000
"""Numbers of cross-covariances that are gathered at once (32 MB). Numerical: bounds the memory."""


def register_pair(
    a: int,
    b: int,
    tracks_a: GridTracks,
    tracks_b: GridTracks,
    max_lag: int,
    options: RegistrationOptions,
    *,
    thresholds: Sequence[float] = VOTE_THRESHOLDS,
) -> tuple[RelativePose, ...]:
    """Hypotheses on a pair of cameras, best first; none where no tracks agree at any lag.

    Parameters
    ----------
    a, b : int
        Indices of the cameras, as the hypotheses carry them.
    tracks_a, tracks_b : GridTracks
        On grids of the same step and start.
    max_lag : int
        Lags are searched within plus and minus this many samples.
    options : RegistrationOptions
    thresholds : sequence of float
        Agreement of bones that is needed; the next one is used where nothing reaches the last.
    """
    if not len(tracks_a.position) or not len(tracks_b.position):
        return ()
    covariance = cross_covariance(tracks_a, tracks_b, max_lag=max_lag)
    vote = _Vote(covariance, tracks_a, tracks_b, options, thresholds)
    if not len(vote.candidates):
        return ()
    found = []
    for R, lag_index in vote.distinct_winners():
        matches, R_a_b, t_a_b, support = vote.consensus(R, lag_index)
        if not matches:
            continue
        lag_s = float(covariance.lags[lag_index]) * tracks_a.step
        found.append(RelativePose(a, b, R_a_b, t_a_b, lag_s, matches, support))
    return tuple(sorted(found, key=lambda h: -h.support))


class _Vote:
    """The votes of all tracks of a pair of cameras for one another's proposals."""

    def __init__(
        self,
        cov: PairCovariance,
        a: GridTracks,
        b: GridTracks,
        options: RegistrationOptions,
        thresholds: Sequence[float],
    ) -> None:
        self.cov, self.a, self.b, self.options = cov, a, b, options
        self.usable = cov.overlap >= options.min_overlap
        self.overlap_a, self.overlap_b = _simultaneous(a.present), _simultaneous(b.present)
        self.threshold, self.candidates = self._candidates(thresholds)

    def _candidates(self, thresholds: Sequence[float]) -> tuple[float, IntArray]:
        """The strongest (track, track, lag) triples, as (K, 3) indices."""
        score = self.cov.score(min_overlap=self.options.min_overlap)
        peak = _local_maxima(np.nan_to_num(score, nan=-1.0))
        for threshold in thresholds:
            gain = np.where(peak, self.cov.mass * (np.nan_to_num(score) - threshold), 0.0).ravel()
            top = np.argsort(-gain, kind="stable")[: self.options.n_candidates]
            top = top[gain[top] > 0]
            if len(top):
                return threshold, np.stack(np.unravel_index(top, score.shape), -1)
        return thresholds[-1], np.zeros((0, 3), dtype=np.int64)

    def gains(self, R: Float64Array, lag: IntArray) -> Float64Array:
        """Support (K, P, Q) of all track pairs for rotations (K, 3, 3) at lags (K,)."""
        out = np.empty((len(R), *self.usable.shape[:2]))
        for block in self._blocks(len(R)):
            at = lag[block]
            agreement = np.einsum("kij,pqkij->kpq", R[block], self.cov.S[:, :, at], optimize=True)
            mass = self.cov.mass[:, :, at].transpose(2, 0, 1)
            usable = self.usable[:, :, at].transpose(2, 0, 1)
            out[block] = np.where(usable, agreement - self.threshold * mass, -np.inf)
        return out

    def _blocks(self, n: int) -> list[slice]:
        """Proposals 0..n-1 in blocks whose covariances (P, Q, block, 3, 3) fit into memory."""
        P, Q = self.usable.shape[:2]
        size = max(1, _BLOCK_VALUES // (9 * P * Q))
        return [slice(begin, begin + size) for begin in range(0, n, size)]

    def distinct_winners(self) -> list[tuple[Float64Array, int]]:
        """Rotations and lag indices after two rounds of vote and refit, best first."""
        p, q, lag = self.candidates.T
        R = best_rotation(self.cov.S[p, q, lag])
        for _ in range(2):
            chosen = self._assign(R, lag)
            R, lag = self._refit(chosen, R, lag)
        gain = self.gains(R, lag).reshape(len(R), -1)
        support = np.where(self._assign(R, lag).reshape(len(R), -1), gain, 0.0).sum(-1)
        kept: list[int] = []
        for k in np.argsort(-support, kind="stable"):
            angles = rotation_angle(R[kept] @ R[k].T)
            near = (angles < SAME_ROTATION) & (np.abs(lag[kept] - lag[k]) <= SAME_LAG)
            if support[k] > 0 and not near.any():
                kept.append(int(k))
            if len(kept) == self.options.n_hypotheses:
                break
        return [(R[k], int(lag[k])) for k in kept]

    def _assign(self, R: Float64Array, lag: IntArray) -> BoolArray:
        gain = self.gains(R, lag)
        pairs = np.argwhere((gain > 0).any(0))
        p, q = pairs.T
        chosen = np.zeros(gain.shape, dtype=bool)
        chosen[:, p, q] = _greedy(gain[:, p, q], pairs, self.overlap_a, self.overlap_b)
        return chosen

    def _refit(
        self, chosen: BoolArray, R: Float64Array, lag: IntArray
    ) -> tuple[Float64Array, IntArray]:
        """Best rotation on all matches, at the best lag near the present one."""
        nearby = np.clip(lag + np.arange(-_LAG_REFIT, _LAG_REFIT + 1)[:, None], 0, None)
        nearby = np.minimum(nearby, len(self.cov.lags) - 1)
        pick = chosen.astype(float)
        S, mass = np.empty((*nearby.shape, 3, 3)), np.empty(nearby.shape)
        for block in self._blocks(len(R)):
            for n, at in enumerate(nearby[:, block]):
                S[n, block] = np.einsum("kpq,pqkij->kij", pick[block], self.cov.S[:, :, at])
                mass[n, block] = np.einsum("kpq,pqk->k", pick[block], self.cov.mass[:, :, at])
        value = best_rotation_trace(S) - self.threshold * mass
        best = value.argmax(0)
        k = np.arange(len(R))
        matched = np.asarray(chosen.any((1, 2)))
        refit = np.where(matched[:, None, None], best_rotation(S[best, k]), R)
        return refit, np.where(matched, nearby[best, k], lag)

    def consensus(
        self, R: Float64Array, lag: int
    ) -> tuple[tuple[tuple[int, int], ...], Float64Array, Float64Array, float]:
        """Return the matches whose positions agree on one translation: no look-alikes."""
        gain = self.gains(R[None], np.array([lag]))[0]
        pairs = np.argwhere(gain > 0)
        if not len(pairs):
            return (), R, np.zeros(3), 0.0
        t = self._translations(R, int(self.cov.lags[lag]), pairs)
        agree = _translation_distance(t) < MAX_POSITION_DIFFERENCE
        strength = gain[tuple(pairs.T)]
        votes = np.where(agree, strength, -np.inf)
        chosen = _greedy(votes, pairs, self.overlap_a, self.overlap_b)
        best = int(np.where(chosen, strength, 0.0).sum(-1).argmax())
        rows = np.flatnonzero(chosen[best])
        if not len(rows):
            return (), R, np.zeros(3), 0.0
        p, q = pairs[rows].T
        R_a_b = best_rotation(self.cov.S[p, q, lag].sum(0))
        t = self._translations(R_a_b, int(self.cov.lags[lag]), pairs[rows])
        t_a_b = np.average(t, axis=0, weights=strength[rows])
        matches = tuple((int(i), int(j)) for i, j in pairs[rows])
        return matches, R_a_b, t_a_b, float(strength[rows].sum())

    def _translations(self, R: Float64Array, lag: int, pairs: IntArray) -> Float64Array:
        """Median of ``T_p - R T_q`` of track pairs (M, 2)."""
        n = self.a.position.shape[1]
        k = np.arange(max(0, -lag), min(n, n - lag))
        here, there = self.a.position[pairs[:, 0]][:, k], self.b.position[pairs[:, 1]][:, k + lag]
        difference = here - there @ R.T
        both = np.asarray(np.isfinite(difference[..., 0]))
        t = np.empty((len(pairs), 3))
        for i, use in enumerate(both):
            at = np.flatnonzero(use)
            at = at[:: -(-len(at) // _MAX_MEDIAN_SAMPLES)]
            t[i] = np.median(difference[i, at], axis=0)
        return t


def _translation_distance(t: Float64Array) -> Float64Array:
    """Return distances (M, M) of translations, least over the possible sizes of the people.

    A lifter that overestimates the size of a person overestimates their distance in every view,
    and so the length of the translation that follows from them.
    """
    square = np.maximum((t**2).sum(-1), 1e-12)
    stretch = np.clip((t @ t.T) / square[None], 1 / BODY_SIZE_RATIO, BODY_SIZE_RATIO)
    one_way = np.linalg.norm(t[:, None] - stretch[..., None] * t[None], axis=-1)
    return np.asarray(np.minimum(one_way, one_way.T))


def _local_maxima(score: Float64Array) -> BoolArray:
    """Where no neighbour along the last axis is greater."""
    padded = np.pad(score, [(0, 0)] * (score.ndim - 1) + [(1, 1)], constant_values=-np.inf)
    return np.asarray((score >= padded[..., :-2]) & (score >= padded[..., 2:]))


def _simultaneous(present: BoolArray) -> BoolArray:
    """Pairs of tracks (P, P) of one camera that have a sample of the grid (P, N) in common."""
    observed = present.astype(np.float32)
    return np.asarray(observed @ observed.T > 0)


def _greedy(
    gain: Float64Array, pairs: IntArray, overlap_a: BoolArray, overlap_b: BoolArray
) -> BoolArray:
    """Greedy choice of compatible track pairs with positive gain, for every row at once.

    A track cannot be two people at one time: (p, q) excludes (p, q') if q and q' overlap in time,
    and (p', q) if p and p' do.

    Parameters
    ----------
    gain : (K, M) ndarray
    pairs : (M, 2) ndarray of int
        Track of a and track of b of each column.
    overlap_a, overlap_b : (P, P) and (Q, Q) ndarray of bool
        Tracks of each camera that overlap in time.

    Returns
    -------
    (K, M) ndarray of bool
    """
    left = gain.copy()
    chosen = np.zeros(gain.shape, dtype=bool)
    rows = np.arange(len(gain))
    p, q = np.ascontiguousarray(pairs.T)
    while len(pairs):
        best = left.argmax(-1)
        wins = left[rows, best] > 0
        if not wins.any():
            break
        k, pick = rows[wins], best[wins]
        chosen[k, pick] = True
        here, there = p[pick], q[pick]
        excluded = (p == here[:, None]) & overlap_b[there][:, q]
        excluded |= (q == there[:, None]) & overlap_a[here][:, p]
        left[k] = np.where(excluded, -np.inf, left[k])
    return chosen
