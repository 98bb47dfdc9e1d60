"""Two-view registration: rotation, offset, association and translation (Section III).

Offsets are examined one by one (Section III-C), for several subsets of the source persons
(RANSAC, Section III-D); the metric of the bipartite matching decides among them.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from stcalib_ros.core.geometry.alignment import best_rotation
from stcalib_ros.core.geometry.so3 import matrix_from_quaternion
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.options import VmfOptions
from stcalib_ros.core.paper.em import Evidence, gather_evidence, maximise
from stcalib_ros.core.paper.limits import (
    MIN_LENGTH_M,
    MIN_MATCH_LIMIT_RAD,
    MIN_POINTS,
    MIN_SAMPLES,
    OUTLIER_FACTOR,
)
from stcalib_ros.core.paper.matching import match, mean_angles
from stcalib_ros.core.paper.oriented import OrientedPoints, samples_of, take
from stcalib_ros.core.paper.translation import translation_direction
from stcalib_ros.core.paper.vmf import VonMisesFisher, fit

_BLOCK = 4_000_000
"""Numbers in one array of a block of offsets at most, 32 MB. Memory alone."""
_MAX_SUBSETS = 30
"""Subsets of the source persons that are tried, count; of more, a random choice. Cost alone."""
_FINALISTS = 24
"""Hypotheses that are matched in full, count; all others lose by the angle to the mean directions.
Cost alone."""
_REFITS = 2
"""Passes of matching and refitting the rotation; matches of good hypotheses stay the same after."""
_MIN_GAIN = 1e-3
"""Support per frame of a hypothesis that matches no better than nobody; keeps it in the graph."""


@dataclass(frozen=True, slots=True, eq=False)
class PairRegistration:
    """One pair of cameras, registered on windows of the first (the target view).

    Attributes
    ----------
    hypothesis : RelativePose
        Relative pose, with the pairs of tracks that are matched in most windows.
    starts : (W,) ndarray of int
        First sample of each window, on the grid of the target.
    matches : (M, 3) ndarray of int
        The association A: window, target track, source track.
    cost_rad : float
        Mean angle of the target persons after rotation, `no_match_rad` for those without a match;
        NaN for registrations by the default method.
    """

    hypothesis: RelativePose
    starts: IntArray
    matches: IntArray
    cost_rad: float


def register(
    a: int,
    b: int,
    target: OrientedPoints,
    source: OrientedPoints,
    starts: IntArray,
    lags: IntArray,
    options: VmfOptions,
    rng: np.random.Generator,
) -> PairRegistration | None:
    """Register two views; return None if nobody in them can be matched.

    Parameters
    ----------
    a, b : int
        Indices of the cameras.
    target, source : OrientedPoints
        Oriented points of camera a and b, on grids of the same step and start.
    starts : (W,) ndarray of int
        First samples of the windows.
    lags : (L,) ndarray of int
        Offsets to examine: sample k of the target is compared with sample k + lag.
    options : VmfOptions
    rng : numpy.random.Generator
        Source of the initial rotations, and of the subsets where there are too many to try all.
    """
    if not len(target.v) or not len(source.v):
        return None
    search = _Search(target, source, starts, lags, options, rng)
    found = search.best()
    return None if found is None else search.registration(a, b, *found)


class _Search:
    """The hypotheses on one pair of cameras."""

    def __init__(
        self,
        target: OrientedPoints,
        source: OrientedPoints,
        starts: IntArray,
        lags: IntArray,
        options: VmfOptions,
        rng: np.random.Generator,
    ) -> None:
        self.target, self.source, self.starts, self.lags = target, source, starts, lags
        self.options, self.rng = options, rng
        samples = samples_of(starts, options.window, np.zeros((), dtype=np.int64))
        self.v, self.known = take(target.v, samples), take(target.known, samples)
        self.model, self.observed = source_model(source, starts, lags, options.window)
        self.ransac = 0 < options.n_hypothesised < len(source.v)

    def best(self) -> tuple[Float64Array, int, BoolArray, float] | None:
        """Return rotation, index of the lag, association and cost of the best hypothesis."""
        if not self.known.any():
            return None
        n_persons = len(self.source.v)
        subsets = self._subsets(n_persons) if self.ransac else [list(range(n_persons))]
        hypothesised = np.zeros((len(subsets), n_persons), dtype=bool)
        np.put_along_axis(hypothesised, np.array(subsets), values=True, axis=-1)
        R, lag, which = self._finalists(subsets, hypothesised)
        evidence = self._evidence(lag)
        limit = self.options.no_match_rad
        if self.ransac:
            sources = hypothesised[which]
            R = self._refitted(R, lag, evidence, sources, limit)
            least = self._least_cost(R, lag, evidence, sources)
            limit = min(limit, max(OUTLIER_FACTOR * least, MIN_MATCH_LIMIT_RAD))
            R = self._refitted(R, lag, evidence, np.ones_like(sources), limit)
        angles, A = self._associate(R, lag, limit)
        each = np.where(A.any(-1), np.where(A, angles, 0.0).sum(-1), limit)
        seen = np.where(evidence.frames > 0, 1.0, 0.0)
        cost = (seen * each).sum((1, 2)) / seen.sum()
        k = int(cost.argmin())
        return (R[k], int(lag[k]), A[k], float(cost[k])) if A[k].any() else None

    def _evidence(self, lag: IntArray) -> Evidence:
        """Return the statistics at some offsets."""
        model = VonMisesFisher(self.model.mu[:, lag], self.model.kappa[:, lag])
        return gather_evidence(self.v, self.known, model, self.observed[:, lag])

    def _refitted(
        self, R: Float64Array, lag: IntArray, evidence: Evidence, sources: BoolArray, limit: float
    ) -> Float64Array:
        """Alternate between matching and rotations, with some source persons (H, Q) only."""
        for _ in range(_REFITS):
            A = self._associate(R, lag, limit)[1] & sources[:, None, None]
            S = np.einsum("hwpq,hwpqij->hij", A * 1.0, evidence.B, optimize=True)
            R = np.where((A.sum((1, 2, 3)) > 0)[:, None, None], best_rotation(S), R)
        return R

    def _least_cost(
        self, R: Float64Array, lag: IntArray, evidence: Evidence, sources: BoolArray
    ) -> float:
        """Return the mean angle of the hypothesised persons (H, Q) in the best hypothesis."""
        limit = self.options.no_match_rad
        angles, A = self._associate(R, lag, limit)
        each = np.where(A.any(2), np.where(A, angles, 0.0).sum(2), limit)
        present: BoolArray = np.asarray(evidence.present.any(2))
        asked = np.where(sources[:, None] & present, 1.0, 0.0)
        n = asked.sum((1, 2))
        mean = (asked * each).sum((1, 2)) / np.maximum(n, 1.0)
        return float(np.where(n > 0, mean, limit).min())

    def _subsets(self, n_persons: int) -> list[list[int]]:
        """Return the sets of source persons hypothesised to be in the target view as well."""
        every = [list(c) for c in combinations(range(n_persons), self.options.n_hypothesised)]
        if len(every) <= _MAX_SUBSETS:
            return every
        chosen = self.rng.choice(len(every), _MAX_SUBSETS, replace=False)
        return [every[i] for i in sorted(chosen)]

    def _fitted(self, evidence: Evidence) -> Float64Array:
        """Return the rotations (L, 3, 3) of the most likely start at every offset."""
        found = maximise(evidence, self._initial(evidence))
        best = found.log_likelihood.argmax(-1)
        return np.asarray(found.R[np.arange(len(best)), best])

    def _initial(self, evidence: Evidence) -> Float64Array:
        """Return initial rotations (L, K, 3, 3): random ones, or of every pair of persons."""
        L, _, P, Q = evidence.present.shape
        if self.options.initial == "candidates":
            present = evidence.present[..., None, None]
            pairs: Float64Array = np.where(present, evidence.B, 0.0).sum(1)
            return best_rotation(pairs.reshape(L, P * Q, 3, 3))
        q = self.rng.standard_normal((L, self.options.n_starts, 4))
        return matrix_from_quaternion(q / np.linalg.norm(q, axis=-1, keepdims=True))

    def _finalists(
        self, subsets: list[list[int]], hypothesised: BoolArray
    ) -> tuple[Float64Array, IntArray, IntArray]:
        """Return the hypotheses (subset, offset) with the smallest angles to the mean directions.

        They are rotations (H, 3, 3), indices of the offset (H,) and of the subset (H,).
        """
        W, P, Q = len(self.starts), len(self.v), len(self.source.v)
        n_starts = P * Q if self.options.initial == "candidates" else self.options.n_starts
        size = max(1, _BLOCK // (W * P * max(9 * Q, n_starts * len(subsets[0]))))
        found: list[tuple[Float64Array, Float64Array, IntArray, IntArray]] = []
        for block in np.split(np.arange(len(self.lags)), range(size, len(self.lags), size)):
            evidence = self._evidence(block)
            R = np.stack([self._fitted(evidence.of_sources(subset)) for subset in subsets])
            cost = self._preliminary_costs(R, block, hypothesised)
            kept = np.argsort(cost.ravel(), kind="stable")[:_FINALISTS]
            lag, which = block[kept % len(block)], kept // len(block)
            found.append((cost.ravel()[kept], R.reshape(-1, 3, 3)[kept], lag, which))
        cost, R, lag, which = (np.concatenate(part) for part in zip(*found, strict=True))
        kept = np.argsort(cost, kind="stable")[:_FINALISTS]
        return R[kept], lag[kept], which[kept]

    def _preliminary_costs(
        self, R: Float64Array, lag: IntArray, hypothesised: BoolArray
    ) -> Float64Array:
        """Sum the angles (N, L) of the persons of N subsets to the nearest target persons."""
        N, L = R.shape[:2]
        known = np.where(self.model.kappa[:, lag] > 0, 1.0, 0.0)
        plain = gather_evidence(
            self.v, self.known, VonMisesFisher(self.model.mu[:, lag], known), self.observed[:, lag]
        )
        joints = self.known.sum(2).transpose(1, 0, 2)
        count: Float64Array = joints @ known.transpose(1, 2, 3, 0)
        flat = R.swapaxes(0, 1).reshape(L, N, 9)
        fit = flat @ plain.B.reshape(L, -1, 9).swapaxes(1, 2)
        mean = fit.reshape(L, N, *count.shape[1:]) / np.maximum(count, 1.0)[:, None]
        usable = (count > 0) & plain.present
        angle = np.where(usable[:, None], np.arccos(np.clip(mean, -1.0, 1.0)), np.inf)
        nearest = np.minimum(angle.min(3), self.options.no_match_rad)
        return np.asarray(np.einsum("lnwq,nq->nl", nearest, hypothesised * 1.0))

    def _associate(
        self, R: Float64Array, lag: IntArray, limit: float
    ) -> tuple[Float64Array, BoolArray]:
        """Return mean angles and associations, both (H, W, P, Q), of hypotheses."""
        samples = samples_of(self.starts, self.options.window, self.lags[lag])
        there, known = take(self.source.v, samples), take(self.source.known, samples)
        angles = mean_angles(self.v, self.known, there, known, R)
        return angles, np.stack([match(one, limit) for one in angles])

    def registration(
        self, a: int, b: int, R: Float64Array, lag: int, A: BoolArray, cost: float
    ) -> PairRegistration:
        """Return the best hypothesis with its translation."""
        matches = np.argwhere(A)
        t = self._translation(R, int(self.lags[lag]), matches)
        gain = 1.0 - cost / self.options.no_match_rad
        frames = float(self.known.max(-1).sum(-1)[matches[:, 1], matches[:, 0]].sum())
        hypothesis = RelativePose(
            a=a,
            b=b,
            R_a_b=R,
            t_a_b=t,
            lag_s=float(self.lags[lag]) * self.target.step,
            matches=_mostly_matched(matches),
            support=max(gain, _MIN_GAIN) * frames,
        )
        return PairRegistration(hypothesis, self.starts, matches, cost)

    def _translation(self, R: Float64Array, lag: int, matches: IntArray) -> Float64Array:
        """Return the epipolar direction with the length of monocular positions."""
        here = (self.starts[matches[:, 0], None] + np.arange(self.options.window)).ravel()
        p, q = (np.repeat(matches[:, i], self.options.window) for i in (1, 2))
        n = self.source.v.shape[1]
        inside = (here + lag >= 0) & (here + lag < n)
        here, p, q = here[inside], p[inside], q[inside]
        x_a, x_b = self.target.x[p, here], self.source.x[q, here + lag]
        both = np.isfinite(x_a + x_b).all(-1)
        if both.sum() < MIN_POINTS:
            return np.zeros(3)
        one = np.ones((int(both.sum()), 1))
        t = translation_direction(R, np.hstack([x_a[both], one]), np.hstack([x_b[both], one]))
        difference = self.target.body[p, here] - self.source.body[q, here + lag] @ R.T
        along = difference[np.isfinite(difference).all(-1)] @ t
        length = abs(float(np.median(along))) if len(along) else 1.0
        return t * max(length, MIN_LENGTH_M)


def source_model(
    source: OrientedPoints, starts: IntArray, lags: IntArray, window: int
) -> tuple[VonMisesFisher, BoolArray]:
    """Fit distributions (Q, L, W, S) at all offsets; return also who is observed (Q, L, W)."""
    n = source.v.shape[1]
    begin = np.clip(starts + lags[:, None], 0, n)
    end = np.clip(starts + lags[:, None] + window, 0, n)
    total = _running(source.v)
    running = _running(source.known)
    counts = np.rint(running[:, end] - running[:, begin])
    return fit(total[:, end] - total[:, begin], counts), counts.max(-1) >= MIN_SAMPLES


def _running(values: Float64Array) -> Float64Array:
    """Return running sums (P, N + 1, ...) over the second axis, from 0."""
    return np.concatenate([np.zeros_like(values[:, :1]), np.cumsum(values, axis=1)], axis=1)


def _mostly_matched(matches: IntArray) -> tuple[tuple[int, int], ...]:
    """Return the pairs of tracks matched in at least half of the windows of the first one."""
    pairs = Counter((int(p), int(q)) for _, p, q in matches)
    firsts = Counter(int(p) for _, p, _ in matches)
    return tuple(sorted(pair for pair, n in pairs.items() if 2 * n >= firsts[pair[0]]))
