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
from stcalib_ros.core.paper.matching import match, mean_angles
from stcalib_ros.core.paper.oriented import OrientedPoints, samples_of, take
from stcalib_ros.core.paper.translation import translation_direction
from stcalib_ros.core.paper.vmf import VonMisesFisher, fit

_BLOCK = 4_000_000
"""Numbers that one array of a block of offsets may have."""
_MAX_SUBSETS = 30
_FINALISTS = 24
_REFITS = 2
_OUTLIER_FACTOR = 2.0
_LEAST_LIMIT_RAD = 0.1
_MIN_POINTS = 8
_SHORTEST_M = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class PairRegistration:
    """One pair of cameras, registered on windows of the first (the target view).

    Attributes
    ----------
    hypothesis : RelativePose
        With the pairs of tracks that are matched in most windows.
    starts : (W,) ndarray of int
        First sample of each window, on the grid of the target.
    matches : (M, 3) ndarray of int
        The association A: window, target track, source track.
    cost_rad : float
        Mean angle of the target persons after rotation, `no_match_rad` where without a match; NaN
        where the default method made it.
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
    o: VmfOptions,
    rng: np.random.Generator,
) -> PairRegistration | None:
    """Register two views, or find that nobody in them can be matched.

    Parameters
    ----------
    a, b : int
        Indices of the cameras, for the record.
    target, source : OrientedPoints
        Of camera a and b, on grids of the same step and start.
    starts : (W,) ndarray of int
        First samples of the windows.
    lags : (L,) ndarray of int
        Offsets to examine: sample k of the target is compared with sample k + lag.
    o : VmfOptions
    rng : numpy.random.Generator
        Of the initial rotations and of the subsets, where there are too many to try all.
    """
    if not len(target.v) or not len(source.v):
        return None
    search = _Search(target, source, starts, lags, o, rng)
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
        o: VmfOptions,
        rng: np.random.Generator,
    ) -> None:
        self.target, self.source, self.starts, self.lags = target, source, starts, lags
        self.o, self.rng = o, rng
        samples = samples_of(starts, o.window, np.zeros((), dtype=np.int64))
        self.v, self.known = take(target.v, samples), take(target.known, samples)
        self.model, self.seen = source_model(source, starts, lags, o.window)
        self.ransac = 0 < o.n_hypothesised < len(source.v)

    def best(self) -> tuple[Float64Array, int, BoolArray, float] | None:
        """Rotation, index of the lag, association and cost of the best hypothesis."""
        if not self.known.any():
            return None
        n_persons = len(self.source.v)
        subsets = self._subsets(n_persons) if self.ransac else [list(range(n_persons))]
        hypothesised = np.zeros((len(subsets), n_persons), dtype=bool)
        np.put_along_axis(hypothesised, np.array(subsets), values=True, axis=-1)
        R, lag, which = self._finalists(subsets, hypothesised)
        evidence = self._evidence(lag)
        limit = self.o.no_match_rad
        if self.ransac:
            sources = hypothesised[which]
            R = self._refitted(R, lag, evidence, sources, limit)
            least = self._least_cost(R, lag, evidence, sources)
            limit = min(limit, max(_OUTLIER_FACTOR * least, _LEAST_LIMIT_RAD))
            R = self._refitted(R, lag, evidence, np.ones_like(sources), limit)
        angles, A = self._associate(R, lag, limit)
        each = np.where(A.any(-1), np.where(A, angles, 0.0).sum(-1), limit)
        seen = np.where(evidence.frames > 0, 1.0, 0.0)
        cost = (seen * each).sum((1, 2)) / seen.sum()
        k = int(cost.argmin())
        return (R[k], int(lag[k]), A[k], float(cost[k])) if A[k].any() else None

    def _evidence(self, lag: IntArray) -> Evidence:
        """Statistics at some offsets."""
        model = VonMisesFisher(self.model.mu[:, lag], self.model.kappa[:, lag])
        return gather_evidence(self.v, self.known, model, self.seen[:, lag])

    def _refitted(
        self, R: Float64Array, lag: IntArray, evidence: Evidence, sources: BoolArray, limit: float
    ) -> Float64Array:
        """Rotations on all matches with some source persons (H, Q), matched again and again."""
        for _ in range(_REFITS):
            A = self._associate(R, lag, limit)[1] & sources[:, None, None]
            S = np.einsum("hwpq,hwpqij->hij", A * 1.0, evidence.B, optimize=True)
            R = np.where((A.sum((1, 2, 3)) > 0)[:, None, None], best_rotation(S), R)
        return R

    def _least_cost(
        self, R: Float64Array, lag: IntArray, evidence: Evidence, sources: BoolArray
    ) -> float:
        """Mean angle of the matches of the hypothesised persons (H, Q), of the best hypothesis."""
        limit = self.o.no_match_rad
        angles, A = self._associate(R, lag, limit)
        each = np.where(A.any(2), np.where(A, angles, 0.0).sum(2), limit)
        present: BoolArray = np.asarray(evidence.present.any(2))
        asked = np.where(sources[:, None] & present, 1.0, 0.0)
        n = asked.sum((1, 2))
        mean = (asked * each).sum((1, 2)) / np.maximum(n, 1.0)
        return float(np.where(n > 0, mean, limit).min())

    def _subsets(self, n_persons: int) -> list[list[int]]:
        """Source persons hypothesised to be seen in the target view as well."""
        every = [list(c) for c in combinations(range(n_persons), self.o.n_hypothesised)]
        if len(every) <= _MAX_SUBSETS:
            return every
        chosen = self.rng.choice(len(every), _MAX_SUBSETS, replace=False)
        return [every[i] for i in sorted(chosen)]

    def _fitted(self, evidence: Evidence) -> Float64Array:
        """Rotations (L, 3, 3) of the likeliest start at every offset."""
        found = maximise(evidence, self._initial(evidence))
        best = found.log_likelihood.argmax(-1)
        return np.asarray(found.R[np.arange(len(best)), best])

    def _initial(self, evidence: Evidence) -> Float64Array:
        """Rotations (L, K, 3, 3): at random, or of every pair of persons."""
        L, _, P, Q = evidence.present.shape
        if self.o.initial == "candidates":
            pairs: Float64Array = np.where(evidence.present[..., None, None], evidence.B, 0.0).sum(
                1
            )
            return best_rotation(pairs.reshape(L, P * Q, 3, 3))
        q = self.rng.standard_normal((L, self.o.n_starts, 4))
        return matrix_from_quaternion(q / np.linalg.norm(q, axis=-1, keepdims=True))

    def _finalists(
        self, subsets: list[list[int]], hypothesised: BoolArray
    ) -> tuple[Float64Array, IntArray, IntArray]:
        """Of all hypotheses (subset, offset) those with the least angle to the mean directions.

        Rotations (H, 3, 3), and indices of the offset and of the subset (H,).
        """
        W, P, Q = len(self.starts), len(self.v), len(self.source.v)
        n_starts = P * Q if self.o.initial == "candidates" else self.o.n_starts
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
        """Summed angles (N, L) of the persons of N subsets to the nearest target persons."""
        N, L = R.shape[:2]
        known = np.where(self.model.kappa[:, lag] > 0, 1.0, 0.0)
        plain = gather_evidence(
            self.v, self.known, VonMisesFisher(self.model.mu[:, lag], known), self.seen[:, lag]
        )
        joints = self.known.sum(2).transpose(1, 0, 2)
        count: Float64Array = joints @ known.transpose(1, 2, 3, 0)
        flat = R.swapaxes(0, 1).reshape(L, N, 9)
        fit = flat @ plain.B.reshape(L, -1, 9).swapaxes(1, 2)
        mean = fit.reshape(L, N, *count.shape[1:]) / np.maximum(count, 1.0)[:, None]
        usable = (count > 0) & plain.present
        angle = np.where(usable[:, None], np.arccos(np.clip(mean, -1.0, 1.0)), np.inf)
        nearest = np.minimum(angle.min(3), self.o.no_match_rad)
        return np.asarray(np.einsum("lnwq,nq->nl", nearest, hypothesised * 1.0))

    def _associate(
        self, R: Float64Array, lag: IntArray, limit: float
    ) -> tuple[Float64Array, BoolArray]:
        """Mean angles and associations, both (H, W, P, Q), of hypotheses."""
        samples = samples_of(self.starts, self.o.window, self.lags[lag])
        there, known = take(self.source.v, samples), take(self.source.known, samples)
        angles = mean_angles(self.v, self.known, there, known, R)
        return angles, np.stack([match(one, limit) for one in angles])

    def registration(
        self, a: int, b: int, R: Float64Array, lag: int, A: BoolArray, cost: float
    ) -> PairRegistration:
        """The record of the winning hypothesis, with its translation."""
        matches = np.argwhere(A)
        t = self._translation(R, int(self.lags[lag]), matches)
        gain = 1.0 - cost / self.o.no_match_rad
        frames = float(self.known.max(-1).sum(-1)[matches[:, 1], matches[:, 0]].sum())
        hypothesis = RelativePose(
            a,
            b,
            R,
            t,
            float(self.lags[lag]) * self.target.step,
            _usual(matches),
            max(gain, 1e-3) * frames,
        )
        return PairRegistration(hypothesis, self.starts, matches, cost)

    def _translation(self, R: Float64Array, lag: int, matches: IntArray) -> Float64Array:
        """Direction from the epipolar constraint, length from where monocular poses stand."""
        here = (self.starts[matches[:, 0], None] + np.arange(self.o.window)).ravel()
        p, q = (np.repeat(matches[:, i], self.o.window) for i in (1, 2))
        n = self.source.v.shape[1]
        inside = (here + lag >= 0) & (here + lag < n)
        here, p, q = here[inside], p[inside], q[inside]
        x_a, x_b = self.target.x[p, here], self.source.x[q, here + lag]
        both = np.isfinite(x_a + x_b).all(-1)
        if both.sum() < _MIN_POINTS:
            return np.zeros(3)
        one = np.ones((int(both.sum()), 1))
        t = translation_direction(R, np.hstack([x_a[both], one]), np.hstack([x_b[both], one]))
        apart = self.target.body[p, here] - self.source.body[q, here + lag] @ R.T
        along = apart[np.isfinite(apart).all(-1)] @ t
        length = abs(float(np.median(along))) if len(along) else 1.0
        return t * max(length, _SHORTEST_M)


def source_model(
    source: OrientedPoints, starts: IntArray, lags: IntArray, window: int
) -> tuple[VonMisesFisher, BoolArray]:
    """Von Mises-Fisher distributions (Q, L, W, S) at all offsets, and who is seen (Q, L, W)."""
    n = source.v.shape[1]
    begin = np.clip(starts + lags[:, None], 0, n)
    end = np.clip(starts + lags[:, None] + window, 0, n)
    total = _running(source.v)
    running = _running(source.known)
    counts = np.rint(running[:, end] - running[:, begin])
    return fit(total[:, end] - total[:, begin], counts), counts.max(-1) >= 2


def _running(values: Float64Array) -> Float64Array:
    """Sums (P, N + 1, ...) of the first entries of the second axis."""
    return np.concatenate([np.zeros_like(values[:, :1]), np.cumsum(values, axis=1)], axis=1)


def _usual(matches: IntArray) -> tuple[tuple[int, int], ...]:
    """Pairs of tracks matched in at least half of the windows in which the first is matched."""
    pairs = Counter((int(p), int(q)) for _, p, q in matches)
    firsts = Counter(int(p) for _, p, _ in matches)
    return tuple(sorted(pair for pair, n in pairs.items() if 2 * n >= firsts[pair[0]]))
