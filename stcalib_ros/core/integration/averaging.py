"""Multi-view integration: one rig from many pairwise hypotheses (Section IV).

Random spanning trees over the hypotheses give candidate rigs; the one that most other
hypotheses agree with is refined by robust averaging of rotations, lags and centres.

References
----------
V. M. Govindu, "Lie-algebraic averaging for globally consistent motion estimation", 2004;
D. Martinec and T. Pajdla, "Robust rotation and translation estimation in multiview
reconstruction", 2007.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stcalib_ros.core.geometry.graphs import spanning_tree
from stcalib_ros.core.geometry.so3 import exp_so3, log_so3, rotation_angle
from stcalib_ros.core.integration.limits import (
    DIFFERENT_LAG_FRAMES,
    DIFFERENT_POSITION,
    DIFFERENT_ROTATION,
    EPIPOLAR_SCALE_PX,
    LAG_SCALE_FRAMES,
    LENGTH_WEIGHT,
    MAX_RIGS,
    MIN_LENGTH,
    MIN_RELIABILITY_RATIO,
    POSITION_SCALE,
    ROTATION_SCALE,
)
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.model.rig import Rig

_IRLS_STEPS = 10
"""Steps of iteratively reweighted least squares. Numerical: it has converged by then."""


def integrate(
    cameras: Sequence[int],
    hypotheses: Sequence[RelativePose],
    *,
    frame_s: float,
    n_trees: int,
    rng: np.random.Generator,
) -> tuple[Rig, ...]:
    """Candidate rigs of one connected group of cameras, the best supported first.

    Parameters
    ----------
    cameras : sequence of int
        The group; its first member becomes the reference.
    hypotheses : sequence of RelativePose
        All hypotheses between cameras of the group.
    frame_s : float
        Frame period, seconds: the scale of lag differences.
    n_trees : int
        Number of random spanning trees.
    rng : numpy.random.Generator
    """
    graph = _Graph(cameras, hypotheses, frame_s)
    rigs = graph.random_rigs(n_trees, rng)
    support = graph.support(*rigs).sum(-1)
    chosen: list[int] = []
    for k in np.argsort(-support, kind="stable"):
        if all(graph.differ(rigs, int(k), j) for j in chosen):
            chosen.append(int(k))
        if len(chosen) == MAX_RIGS:
            break
    averaged = [graph.average(*(part[k] for part in rigs)) for k in chosen]
    return tuple(sorted(averaged, key=lambda rig: -rig.support))


class _Graph:
    """Pair hypotheses as edges between the cameras of one group."""

    def __init__(
        self, cameras: Sequence[int], hypotheses: Sequence[RelativePose], frame_s: float
    ) -> None:
        self.cameras = np.array(cameras, dtype=np.int64)
        node = {int(c): i for i, c in enumerate(cameras)}
        self.a = np.array([node[h.a] for h in hypotheses])
        self.b = np.array([node[h.b] for h in hypotheses])
        self.R = np.stack([h.R_a_b for h in hypotheses])
        self.t = np.stack([h.t_a_b for h in hypotheses])
        length = np.linalg.norm(self.t, axis=-1, keepdims=True)
        self.direction = self.t / np.maximum(length, MIN_LENGTH)
        self.lag = np.array([h.lag_s for h in hypotheses])
        self.weight = np.array([reliability(h) for h in hypotheses])
        self.frame_s = frame_s
        _, self.pair = np.unique(self.a * len(cameras) + self.b, return_inverse=True)

    def random_rigs(
        self, n_trees: int, rng: np.random.Generator
    ) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Rigs (K, C, ...) along random spanning trees that prefer heavy edges."""
        C = len(self.cameras)
        R = np.tile(np.eye(3), (n_trees, C, 1, 1))
        t, offset = np.zeros((n_trees, C, 3)), np.zeros((n_trees, C))
        for k in range(n_trees):
            noise = rng.gumbel(size=len(self.weight)) * (1.0 if k else 0.0)
            order = np.argsort(-(np.log(self.weight) + noise), kind="stable")
            for e, forward in spanning_tree(self.a, self.b, order, C):
                a, b = self.a[e], self.b[e]
                if forward:
                    R[k, b] = R[k, a] @ self.R[e]
                    t[k, b] = t[k, a] + R[k, a] @ self.t[e]
                    offset[k, b] = offset[k, a] - self.lag[e]
                else:
                    R[k, a] = R[k, b] @ self.R[e].T
                    t[k, a] = t[k, b] - R[k, a] @ self.t[e]
                    offset[k, a] = offset[k, b] + self.lag[e]
        return R, t, offset

    def residuals(
        self, R: Float64Array, t: Float64Array, offset: Float64Array
    ) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Angle (rad), distance (m) and lag difference (frames), each (..., E)."""
        R_a = R[..., self.a, :, :]
        relative = np.swapaxes(R_a, -1, -2) @ R[..., self.b, :, :]
        angle = rotation_angle(np.swapaxes(relative, -1, -2) @ self.R)
        predicted = np.einsum("...ji,...j->...i", R_a, t[..., self.b, :] - t[..., self.a, :])
        distance = self._misplaced(predicted - self.t)
        lag = offset[..., self.a] - offset[..., self.b] - self.lag
        return angle, distance, np.abs(lag) / self.frame_s

    def agreement(self, R: Float64Array, t: Float64Array, offset: Float64Array) -> Float64Array:
        """How well each hypothesis fits the rigs, 0..1, (..., E)."""
        angle, distance, lag = self.residuals(R, t, offset)
        return np.asarray(
            1.0
            / (
                1.0
                + (angle / ROTATION_SCALE) ** 2
                + (distance / POSITION_SCALE) ** 2
                + (lag / LAG_SCALE_FRAMES) ** 2
            )
        )

    def support(self, R: Float64Array, t: Float64Array, offset: Float64Array) -> Float64Array:
        """Weight of the best fitting hypothesis of every pair, (..., pairs)."""
        value = self.agreement(R, t, offset) * self.weight
        best = np.zeros((*value.shape[:-1], self.pair.max() + 1))
        for e, pair in enumerate(self.pair):
            best[..., pair] = np.maximum(best[..., pair], value[..., e])
        return best

    def differ(self, rigs: tuple[Float64Array, ...], k: int, j: int) -> bool:
        """Two rigs that averaging would not bring together."""
        R, t, offset = rigs
        angle = rotation_angle(np.swapaxes(R[k], -1, -2) @ R[j]).max()
        shift = np.linalg.norm(t[k] - t[j], axis=-1).max()
        lag = np.abs(offset[k] - offset[j]).max() / self.frame_s
        return bool(
            angle > DIFFERENT_ROTATION or shift > DIFFERENT_POSITION or lag > DIFFERENT_LAG_FRAMES
        )

    def average(self, R: Float64Array, t: Float64Array, offset: Float64Array) -> Rig:
        """Iteratively reweighted averaging of rotations, offsets and centres."""
        R, t, offset = R.copy(), t.copy(), offset.copy()
        start = float(self.support(R, t, offset).sum())
        begin = (R.copy(), t.copy(), offset.copy())
        for _ in range(_IRLS_STEPS):
            w = self.weight * self.agreement(R, t, offset) ** 2
            relative = R[self.a] @ self.R @ np.swapaxes(R[self.b], -1, -2)
            R = exp_so3(self._solve(w, log_so3(relative))) @ R
            offset = self._solve(w, -self.lag[:, None])[:, 0]
            t = self._centres(w, R)
        end = float(self.support(R, t, offset).sum())
        if end < start:
            (R, t, offset), end = begin, start
        return Rig(self.cameras, R, t, offset, end)

    def _misplaced(self, difference: Float64Array) -> Float64Array:
        """Length (..., E) of differences of translations; along them, they are less certain."""
        along = (difference * self.direction).sum(-1)
        square = (difference**2).sum(-1) - (1.0 - LENGTH_WEIGHT) * along**2
        return np.asarray(np.sqrt(np.maximum(square, 0.0)))

    def _centres(self, w: Float64Array, R: Float64Array) -> Float64Array:
        """Camera centres (C, 3), the first one at 0, in weighted least squares of all edges."""
        C = len(self.cameras)
        d = np.einsum("eij,ej->ei", R[self.a], self.direction)
        W = np.eye(3) - (1.0 - LENGTH_WEIGHT) * d[:, :, None] * d[:, None, :]
        W *= w[:, None, None]
        g_e = np.einsum("eij,ej->ei", W, np.einsum("eij,ej->ei", R[self.a], self.t))
        H, g = np.zeros((C, 3, C, 3)), np.zeros((C, 3))
        for a, b, block, right in zip(self.a, self.b, W, g_e, strict=True):
            for i, j, sign in ((a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)):
                H[i, :, j] += sign * block
            g[b] += right
            g[a] -= right
        free = H[1:, :, 1:].reshape(3 * (C - 1), 3 * (C - 1))
        free = free + 1e-9 * np.trace(free) * np.eye(len(free))
        t = np.zeros((C, 3))
        t[1:] = np.linalg.solve(free, g[1:].ravel()).reshape(-1, 3)
        return t

    def _solve(self, w: Float64Array, difference: Float64Array) -> Float64Array:
        """Node values (C, k) with ``value_b - value_a = difference`` in weighted least squares."""
        C = len(self.cameras)
        B = np.zeros((len(w), C))
        rows = np.arange(len(w))
        B[rows, self.b] += 1.0
        B[rows, self.a] -= 1.0
        H = B.T @ (w[:, None] * B)
        g = B.T @ (w[:, None] * difference)
        value = np.zeros((C, difference.shape[1]))
        if C > 1:
            ridge = 1e-9 * np.trace(H) * np.eye(C - 1)
            value[1:] = np.linalg.solve(H[1:, 1:] + ridge, g[1:])
        return value


def reliability(h: RelativePose) -> float:
    """Support, discounted where the keypoints contradict the hypothesis."""
    return h.support / (1.0 + (h.epipolar_px / EPIPOLAR_SCALE_PX) ** 2)


def credible(hypotheses: Sequence[RelativePose]) -> tuple[RelativePose, ...]:
    """Drop hypotheses that are much less reliable than what both of their cameras have elsewhere.

    Of two cameras that see different people something agrees as well.
    """
    best: dict[int, float] = {}
    for h in hypotheses:
        for c in (h.a, h.b):
            best[c] = max(best.get(c, 0.0), reliability(h))
    return tuple(
        h for h in hypotheses if reliability(h) >= MIN_RELIABILITY_RATIO * min(best[h.a], best[h.b])
    )
