"""Cross-covariance of oriented points at all time offsets at once.

For fixed tracks p, q and lag d the rotation that aligns their oriented points (the first
cost of Section III-A) depends on them only through ``S_pqd = sum m m' v_p v_q'^T``, summed
over frames and bones. As a function of the lag this is a cross-correlation, so that all
offsets of the search range cost one Fourier transform.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from stcalib_ros.core.geometry.alignment import best_rotation_trace
from stcalib_ros.core.model.arrays import BoolArray, Float32Array, Float64Array, IntArray
from stcalib_ros.core.registration.resampling import GridTracks

_BLOCK_VALUES = 2_000_000
"""Numbers of a transform that are held at once (16 MB). Numerical: bounds the memory."""


@dataclass(frozen=True, slots=True, eq=False)
class PairCovariance:
    """Cross-covariances of all tracks of two cameras at all lags.

    Attributes
    ----------
    S : (P, Q, L, 3, 3) ndarray
        ``sum m m' v_a v_b^T``.
    mass : (P, Q, L) ndarray
        ``sum m m'``: the greatest value that ``tr(R^T S)`` can have.
    overlap : (P, Q, L) ndarray
        Samples in which both tracks are observed.
    lags : (L,) ndarray of int
        Sample k of camera a is compared with sample k + lag of camera b.
    """

    S: Float64Array
    mass: Float64Array
    overlap: Float64Array
    lags: IntArray

    def score(self, *, min_overlap: int) -> Float64Array:
        """Cosine-like agreement (P, Q, L) after the best rotation; NaN below `min_overlap`."""
        enough: BoolArray = self.overlap >= min_overlap
        score = np.full(self.mass.shape, np.nan)
        score[enough] = best_rotation_trace(self.S[enough]) / np.maximum(self.mass[enough], 1e-9)
        return score


def cross_covariance(a: GridTracks, b: GridTracks, *, max_lag: int) -> PairCovariance:
    """Cross-covariances at the lags ``-max_lag .. max_lag`` by fast Fourier transform."""
    n = a.oriented.shape[1]
    max_lag = min(max_lag, n - 1)
    size = int(fft.next_fast_len(n + max_lag, real=True))
    lags = np.arange(-max_lag, max_lag + 1)
    S = _correlate(_stack(a.oriented), _stack(b.oriented), size, lags)
    P, Q = len(a.oriented), len(b.oriented)
    S = S.reshape(P, 3, Q, 3, len(lags)).transpose(0, 2, 4, 1, 3)
    mass = _correlate(a.weight.transpose(1, 0, 2), b.weight.transpose(1, 0, 2), size, lags)
    overlap = _correlate(_presence(a), _presence(b), size, lags)
    return PairCovariance(S, mass, np.rint(overlap), lags)


def _stack(oriented: Float32Array) -> Float32Array:
    """(P, N, D, 3) to (N, 3 P, D)."""
    P, n, D, _ = oriented.shape
    return np.asarray(oriented.transpose(1, 0, 3, 2).reshape(n, 3 * P, D))


def _presence(tracks: GridTracks) -> Float32Array:
    return np.asarray(tracks.present.T[..., None], dtype=np.float32)


def _correlate(a: Float32Array, b: Float32Array, size: int, lags: IntArray) -> Float64Array:
    """``sum_k a[k] @ b[k + lag]^T`` for every lag: (N, A, D), (N, B, D) to (A, B, L).

    Some of the A at a time: of all lags that the transforms give, few are kept.
    """
    A, B = a.shape[1], b.shape[1]
    spectrum_b = fft.rfft(b, size, axis=0).transpose(0, 2, 1)
    at_once = max(1, _BLOCK_VALUES // (size * B))
    out = np.empty((A, B, len(lags)))
    for begin in range(0, A, at_once):
        rows = slice(begin, begin + at_once)
        spectrum_a = np.conj(fft.rfft(a[:, rows], size, axis=0))
        series = fft.irfft(spectrum_a @ spectrum_b, size, axis=0)
        out[rows] = series[lags % size].transpose(1, 2, 0)
    return out
