"""Cameras that would fit at another place as well, since everybody they observe has a look-alike.

Among people who move identically, a camera that observes only some of them cannot know which ones.
It fits as well where one rigid motion takes each person that it observes to a look-alike. Who is
at the same place is no look-alike, but the same person in two pieces.
"""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.state import triangulated
from stcalib_ros.core.geometry.alignment import umeyama
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.validation.thresholds import (
    MAX_LOOKALIKE_DISTANCE,
    MIN_JOINTS_OF_PERSON,
    MIN_LOOKALIKE_OVERLAP,
    MIN_LOOKALIKE_SAMPLES,
    SAME_PLACE_DISTANCE,
)

_MAX_SAMPLES = 200
"""Time steps of the clip that are compared; purely numerical: neighbouring ones hardly differ."""


def has_lookalike_alternative(last: Iteration) -> BoolArray:
    """Find the cameras (C,) that observe nobody who is distinguishable from somebody else.

    Parameters
    ----------
    last : Iteration

    References
    ----------
    S. Umeyama, "Least-squares estimation of transformation parameters between two point patterns",
    IEEE Transactions on Pattern Analysis and Machine Intelligence 13 (4), 1991.
    """
    paths, observed = _paths(last)
    return np.array([_all_have_lookalikes(paths, observed[:, c]) for c in range(observed.shape[1])])


def _paths(last: Iteration) -> tuple[Float64Array, BoolArray]:
    """Joints (P, K, J, 3) of all persons at some time bins, and where a camera observes them.

    The latter is (P, C, K). Joints that are not triangulated are NaN.
    """
    obs, state = last.observations, last.state
    bins = np.unique(obs.time_bin)
    bins = bins[:: -(-len(bins) // _MAX_SAMPLES)]
    rows = np.flatnonzero(np.isin(obs.time_bin, bins))
    _, p = np.unique(obs.person[rows], return_inverse=True)
    k = np.searchsorted(bins, obs.time_bin[rows])
    inlier = state.inlier[rows]
    X = np.where(triangulated(inlier)[..., None], state.X[rows], np.nan)
    P, K = int(p.max(initial=-1)) + 1, len(bins)
    paths = np.full((P, K, *X.shape[1:]), np.nan)
    paths[p, k] = X
    observed = np.zeros((P, inlier.shape[1], K), dtype=bool)
    observed[p, :, k] = inlier.sum(-1) >= MIN_JOINTS_OF_PERSON
    return paths, observed


def _all_have_lookalikes(paths: Float64Array, observed: BoolArray) -> bool:
    """Whether one motion takes all persons (P, K, J, 3), where observed (P, K), to others."""
    count = observed.sum(-1)
    order = np.argsort(-count, kind="stable")
    persons = [int(p) for p in order if count[p] >= MIN_LOOKALIKE_SAMPLES]
    if not persons:
        return False
    first, *rest = persons
    for other in range(len(paths)):
        here, there = paths[first, observed[first]], paths[other, observed[first]]
        if other == first or not _overlaps(here, there):
            continue
        if np.nanmedian(np.linalg.norm(here - there, axis=-1)) < SAME_PLACE_DISTANCE:
            continue
        both = np.isfinite(here + there).all(-1)
        _, R, _ = umeyama(here[both], there[both])
        t = there[both].mean(0) - here[both].mean(0) @ R.T
        if _coincide(here @ R.T + t, there) and all(
            any(
                _coincide(paths[p, observed[p]] @ R.T + t, candidate[observed[p]])
                for candidate in paths
            )
            for p in rest
        ):
            return True
    return False


def _overlaps(a: Float64Array, b: Float64Array) -> bool:
    """Whether the second of two paths (K, J, 3) is known for most of the time of the first."""
    a_known, b_known = (
        np.isfinite(path).all(-1).sum(-1) >= MIN_JOINTS_OF_PERSON for path in (a, b)
    )
    least = max(MIN_LOOKALIKE_OVERLAP * a_known.sum(), MIN_LOOKALIKE_SAMPLES)
    return bool((a_known & b_known).sum() >= least)


def _coincide(a: Float64Array, b: Float64Array) -> bool:
    """Whether two paths (K, J, 3) overlap and are at the same place."""
    square = ((a - b) ** 2).sum(-1)
    return _overlaps(a, b) and bool(np.sqrt(np.nanmean(square)) < MAX_LOOKALIKE_DISTANCE)
