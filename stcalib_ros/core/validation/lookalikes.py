"""Cameras that would fit at another place as well, since everybody whom they see has a double.

Of people who move alike, a camera that sees only some cannot tell which ones. It fits as well where
one motion of space takes each of those whom it sees to somebody who moves like him.
"""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.state import triangulated
from stcalib_ros.core.geometry.alignment import umeyama
from stcalib_ros.core.model.arrays import BoolArray, Float64Array

_MAX_MOMENTS = 200
_MIN_MOMENTS = 8
_MIN_JOINTS = 6
_OVERLAP = 0.8
_ALIKE = 0.08
"""Root mean square distance of the joints of two who move alike, in units of about a metre."""


def has_lookalike_alternative(last: Iteration) -> BoolArray:
    """Cameras (C,) that see nobody whom they could tell from somebody else at another place.

    Parameters
    ----------
    last : Iteration
    """
    paths, seen = _paths(last)
    return np.array([_all_doubled(paths, seen[:, c]) for c in range(seen.shape[1])])


def _paths(last: Iteration) -> tuple[Float64Array, BoolArray]:
    """Joints (P, K, J, 3) of all persons at some moments, and who of them (P, C, K) is seen."""
    o, state = last.observations, last.state
    knots = np.unique(o.knot)
    knots = knots[:: -(-len(knots) // _MAX_MOMENTS)]
    rows = np.flatnonzero(np.isin(o.knot, knots))
    _, p = np.unique(o.person[rows], return_inverse=True)
    k = np.searchsorted(knots, o.knot[rows])
    used = state.used[rows]
    X = np.where(triangulated(used)[..., None], state.X[rows], np.nan)
    P, K = int(p.max(initial=-1)) + 1, len(knots)
    paths = np.full((P, K, *X.shape[1:]), np.nan)
    paths[p, k] = X
    seen = np.zeros((P, used.shape[1], K), dtype=bool)
    seen[p, :, k] = used.sum(-1) >= _MIN_JOINTS
    return paths, seen


def _all_doubled(paths: Float64Array, seen: BoolArray) -> bool:
    """Whether one motion takes all persons (P, K, J, 3) where they are seen (P, K) to others."""
    count = seen.sum(-1)
    persons = [int(p) for p in np.argsort(-count, kind="stable") if count[p] >= _MIN_MOMENTS]
    if not persons:
        return False
    first, *rest = persons
    for other in range(len(paths)):
        here, there = paths[first, seen[first]], paths[other, seen[first]]
        if other == first or not _together(here, there):
            continue
        both = np.isfinite(here + there).all(-1)
        _, R, _ = umeyama(here[both], there[both])
        t = there[both].mean(0) - here[both].mean(0) @ R.T
        if _alike(here @ R.T + t, there) and all(
            any(_alike(paths[p, seen[p]] @ R.T + t, other_path[seen[p]]) for other_path in paths)
            for p in rest
        ):
            return True
    return False


def _together(a: Float64Array, b: Float64Array) -> bool:
    """Whether the second of two paths (K, J, 3) is known for most of the time of the first."""
    a_known, b_known = (np.isfinite(path).all(-1).sum(-1) >= _MIN_JOINTS for path in (a, b))
    return bool((a_known & b_known).sum() >= max(_OVERLAP * a_known.sum(), _MIN_MOMENTS))


def _alike(a: Float64Array, b: Float64Array) -> bool:
    square = ((a - b) ** 2).sum(-1)
    return _together(a, b) and bool(np.sqrt(np.nanmean(square)) < _ALIKE)
