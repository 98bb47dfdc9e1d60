"""Uniform cubic B-splines: their values, and the normal equations of their coefficients.

Positions are in units of the step between knots. At a position, the four splines that are not zero
begin at its whole part, so that normal equations have a narrow band.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from stcalib_ros.core.model.arrays import Float64Array, IntArray

_PIECE = np.array([[1, -3, 3, -1], [4, 0, -6, 3], [1, 3, 3, -3], [0, 0, 0, 1]]) / 6.0
"""Coefficients, by power of the fraction of a step, of the four B-splines that are not zero."""
SUPPORT = 4
"""Number of splines that are not zero at a position: those of a cubic."""


def basis(position: Float64Array, derivative: int = 0) -> Float64Array:
    """The four B-splines (4, T) that are not zero at positions, or a derivative by the position."""
    piece = _PIECE
    for _ in range(derivative):
        piece = piece[:, 1:] * np.arange(1, piece.shape[1])
    return np.asarray(piece @ (position % 1.0) ** np.arange(piece.shape[1])[:, None])


def first_of(position: Float64Array) -> IntArray:
    """Number (T,) of the first spline that is not zero at positions."""
    return np.floor(position).astype(np.int64)


def values(position: Float64Array, coefficients: Float64Array, derivative: int = 0) -> Float64Array:
    """Curves (T, ...) of coefficients (K, ...) at positions, or a derivative by the position."""
    first, weight = first_of(position), basis(position, derivative)
    return np.asarray(
        sum(
            w.reshape(-1, *[1] * (coefficients.ndim - 1)) * coefficients[first + n]
            for n, w in enumerate(weight)
        )
    )


def summed(position: Float64Array, K: int, weight: Float64Array, of: Float64Array) -> Float64Array:
    """Sums (K, ...) of values (T, ...) to the coefficients they depend on, by weights (n, T)."""
    n, T = weight.shape
    if not T:
        return np.zeros((K, *of.shape[1:]))
    row = first_of(position) + np.arange(n)[:, None]
    sums = csr_array((weight.ravel(), (row.ravel(), np.tile(np.arange(T), n))), shape=(K, T))
    return np.asarray(sums @ of.reshape(T, -1)).reshape(K, *of.shape[1:])


def summed_squares(position: Float64Array, K: int, of: Float64Array) -> Float64Array:
    """Blocks (4, K, ...) of normal equations on and beside the diagonal, of values (T, ...)."""
    weight = basis(position)
    return np.stack(
        [summed(position, K, weight[: SUPPORT - d] * weight[d:], of) for d in range(SUPPORT)]
    )


def smoothness(K: int, precision: Float64Array) -> Float64Array:
    """Blocks (4, K, M, 3, 3) that keep second differences of curves small, by precisions (M,)."""
    pattern = second_differences(K)[:, :, None, None, None]
    return np.asarray(pattern * np.eye(3) * precision[:, None, None])


def second_differences(K: int) -> Float64Array:
    """Normal equations (4, K), diagonal and beside it, of ``c_k - 2 c_k+1 + c_k+2`` of K."""
    second = np.array([1.0, -2.0, 1.0])
    out = np.zeros((SUPPORT, K))
    for d in range(3):
        for i in range(3 - d):
            out[d, i : K - 2 + i] += second[i] * second[i + d]
    return out


def banded(N: Float64Array) -> Float64Array:
    """Lower diagonals (M, 12, 3 K) of blocks (4, K, M, 3, 3) on and beside the diagonal."""
    _, K, M, _, _ = N.shape
    band = np.zeros((M, 3 * SUPPORT, 3 * K))
    for d, i, j in np.ndindex(SUPPORT, 3, 3):
        if 3 * d + j - i >= 0:
            band[:, 3 * d + j - i, i::3] = N[d, :, :, i, j].T
    return band
