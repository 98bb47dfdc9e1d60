"""Triangulation of points from bearing rays."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.arrays import BoolArray, Float32Array, Float64Array


def unit_rays(x: Float32Array | Float64Array) -> Float64Array:
    """Unit directions (..., 3), of the precision of x, to points (..., 2) of the plane z = 1."""
    rays = np.concatenate([x, np.ones_like(x[..., :1])], -1)
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


def triangulate(
    centres: Float64Array, rays: Float64Array, weights: Float64Array, *, refinements: int = 2
) -> tuple[Float64Array, BoolArray]:
    """Return the points nearest to several rays each, weighted by inverse distance.

    The closed form of the midpoint method, iterated for its weights.

    Parameters
    ----------
    centres : (..., C, 3) ndarray
        Camera centres.
    rays : (..., C, 3) ndarray
        Unit directions in the same frame; anything where the weight is 0.
    weights : (..., C) ndarray
        0 for a camera that does not observe the point.
    refinements : int
        Number of passes that use the distances as weights.

    Returns
    -------
    X : (..., 3) ndarray
        NaN where fewer than two rays, or parallel ones only, are given.
    good : (...) ndarray of bool
        Where `X` is finite and ahead of every camera that observes it.
    """
    observed = weights > 0
    b = [np.where(observed, rays[..., i], 0.0) for i in range(3)]
    origin = [np.where(observed, centres[..., i], 0.0) for i in range(3)]
    along = sum(b[i] * origin[i] for i in range(3))
    enough = observed.sum(-1) >= 2
    w = weights
    for _ in range(1 + refinements):
        total = w.sum(-1)
        A = {(i, j): -(w * b[i] * b[j]).sum(-1) for i, j in _UPPER}
        for i in range(3):
            A[i, i] += total
        right = [(w * (origin[i] - along * b[i])).sum(-1) for i in range(3)]
        X, ok = _solve_symmetric(A, right)
        depth = sum(b[i] * (X[i][..., None] - origin[i]) for i in range(3))
        w = weights / np.maximum(depth, 1e-3) ** 2
    ahead = ((depth > 0) | ~observed).all(-1)
    good = ok & enough
    return np.where(good[..., None], np.stack(X, -1), np.nan), good & ahead


_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Entries of a symmetric 3x3 matrix on and above its diagonal."""


def _solve_symmetric(
    A: dict[tuple[int, int], Float64Array], b: list[Float64Array]
) -> tuple[list[Float64Array], BoolArray]:
    """Cramer's rule for many symmetric 3x3 systems at once, and whether each is regular."""
    c00 = A[1, 1] * A[2, 2] - A[1, 2] ** 2
    c01 = A[0, 2] * A[1, 2] - A[0, 1] * A[2, 2]
    c02 = A[0, 1] * A[1, 2] - A[0, 2] * A[1, 1]
    c11 = A[0, 0] * A[2, 2] - A[0, 2] ** 2
    c12 = A[0, 1] * A[0, 2] - A[0, 0] * A[1, 2]
    c22 = A[0, 0] * A[1, 1] - A[0, 1] ** 2
    det = A[0, 0] * c00 + A[0, 1] * c01 + A[0, 2] * c02
    trace = A[0, 0] + A[1, 1] + A[2, 2]
    ok = det > 1e-9 * np.maximum(trace, 1e-300) ** 3
    inverse = np.where(ok, 1.0, 0.0) / np.where(ok, det, 1.0)
    rows = ((c00, c01, c02), (c01, c11, c12), (c02, c12, c22))
    return [sum(c * x for c, x in zip(row, b, strict=True)) * inverse for row in rows], ok
