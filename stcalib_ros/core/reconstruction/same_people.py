"""Persons of the adjustment who are one: split between groups of cameras, or at a lost track."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.reconstruction.limits import (
    MAX_SAME_DISTANCE,
    MAX_SEEN_BOTH_FRACTION,
    MIN_SAME_BINS,
    MIN_SAME_FRACTION,
)


def same_people(last: Iteration) -> tuple[tuple[int, ...], ...]:
    """Group the persons of an adjustment, by their numbers in the observations.

    Two are one if they are at one place whenever both are known in 3D, for a few time bins at
    least, and hardly any camera sees both in one image.

    Parameters
    ----------
    last : Iteration

    Returns
    -------
    tuple of tuple of int
        Everybody is in one group; most are alone in theirs.
    """
    obs = last.observations
    numbers, index = np.unique(obs.person, return_inverse=True)
    together, near, seen_both = _encounters(last, index, len(numbers))
    group = np.arange(len(numbers))
    pairs = np.argwhere(np.triu(near >= MIN_SAME_BINS, 1))
    for i, j in pairs[np.argsort(-near[tuple(pairs.T)], kind="stable")].tolist():
        first, second = np.flatnonzero(group == group[i]), np.flatnonzero(group == group[j])
        counts = (n[np.ix_(first, second)].sum() for n in (together, near, seen_both))
        n_together, n_near, n_seen_both = counts
        at_one_place = n_near >= MIN_SAME_FRACTION * n_together
        if at_one_place and n_seen_both <= MAX_SEEN_BOTH_FRACTION * n_together:
            group[second] = group[i]
    groups = [tuple(numbers[group == g].tolist()) for g in np.unique(group)]
    return tuple(sorted(groups))


def _encounters(last: Iteration, index: IntArray, n: int) -> tuple[IntArray, IntArray, IntArray]:
    """Count time bins for every two persons (n, n).

    Those in which both are known in 3D, those of them in which both are at one place, and those in
    which one camera sees both.
    """
    obs, state = last.observations, last.state
    known = state.inlier.sum(1) >= 2
    X = np.where(known[..., None], state.X, np.nan)
    whole = np.flatnonzero(known.sum(1) > known.shape[1] // 2)
    limit = MAX_SAME_DISTANCE * _body_size(X[whole])
    together, near, seen_both = np.zeros((3, n, n), dtype=np.int64)
    order = whole[np.argsort(obs.time_bin[whole], kind="stable")]
    edges = np.flatnonzero(np.diff(obs.time_bin[order])) + 1
    for rows in np.split(order, edges):
        if len(rows) < 2:
            continue
        who = np.ix_(index[rows], index[rows])
        between = np.linalg.norm(X[rows, None] - X[rows], axis=-1)
        apart = np.nanmedian(between, axis=-1)
        together[who] += np.isfinite(apart)
        near[who] += apart < limit
        seen = (obs.track[rows] >= 0).astype(np.int64)
        seen_both[who] += seen @ seen.T > 0
    return together, near, seen_both


def _body_size(X: Float64Array) -> float:
    """Typical extent of a body, in the unit of the joints (N, J, 3)."""
    extents = np.linalg.norm(np.nanmax(X, axis=1) - np.nanmin(X, axis=1), axis=-1)
    return float(np.median(extents)) if len(X) else 0.0
