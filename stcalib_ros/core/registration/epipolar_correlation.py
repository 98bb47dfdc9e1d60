"""How well one essential matrix explains two tracks, at all time offsets at once.

Every joint of every frame is a point correspondence under one essential matrix if persons and
offset are right. For a lag d the algebraic error is ``e^T M e`` with e = vec(E) and

    M(d) = sum over frames t and joints s of (x_a x_a^T) (x) (x_b x_b^T),

x_a at t and x_b at t + d. Its entries are sums of a monomial of x_a times a monomial of x_b, so
that 36 cross-correlations of the six monomials give M at all lags. What noise of unit variance adds
to it is, with S = diag(1, 1, 0), from the same correlations

    N(d) = sum of (x_a x_a^T) (x) S + S (x) (x_b x_b^T).

The smallest generalised eigenvalue of (M, N) is, to first order, the mean squared Sampson distance
of the best essential matrix, without the bias of the eight-point method. M and N of several pairs
of tracks add up.

References
----------
W. Chojnacki, M. J. Brooks, A. van den Hengel, D. Gawley, "On the fitting of surfaces to data with
covariances", IEEE Transactions on Pattern Analysis and Machine Intelligence 22 (11), 2000;
Y. Leedan and P. Meer, "Heteroscedastic regression in computer vision: problems with bilinear
constraint", International Journal of Computer Vision 37 (2), 2000.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import fft

from stcalib_ros.core.geometry.interpolation import Interpolation, frame_period
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.registration.resampling import Grid

_FACTORS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Coordinates of (x, y, 1) whose products are the monomials."""
N_MONOMIALS = len(_FACTORS)
"""Monomials x^2, xy, x, y^2, y and 1 of an image point, count. Derived: products of two of three
homogeneous coordinates."""
ONE = N_MONOMIALS - 1
"""Index of the monomial 1, whose correlation counts common points. Derived: the last one."""
_SQUARE = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
"""Monomial of the product of every two coordinates."""
_NOISE = np.diag([1.0, 1.0, 0.0])
"""Covariance of an image point with noise of unit variance."""
_RIDGE = 1e-10
"""Ratio to the mean diagonal of M. Numerical: exact points have a singular M."""
_DOUBLINGS = 4
"""Squarings of a matrix by which its largest eigenvalue is bounded. Numerical: the trace of the
16th power is off by less than 15 % in it, for nine eigenvalues, and by 1 % if one dominates."""


@dataclass(frozen=True, slots=True, eq=False)
class KeypointMoments:
    """Monomials of the keypoints of some tracks of a camera, on a grid.

    Attributes
    ----------
    values : tuple of (6, F, J) ndarray
        Monomials of each track, over the samples from its first to its last; 0 where not observed.
    first, end : (P,) ndarray of int
        Samples of the grid at which each of them begins, and after which it has ended.
    focal_px : float
        Usual focal length.
    """

    values: tuple[Float64Array, ...]
    first: IntArray
    end: IntArray
    focal_px: float

    def thinned(self, every: int) -> KeypointMoments:
        """Keep every n-th sample of the grid."""
        start = -self.first % every
        values = tuple(v[:, s::every] for v, s in zip(self.values, start, strict=True))
        return _of_values(values, (self.first + start) // every, self.focal_px)


def keypoint_moments(camera: LiftedCamera, grid: Grid) -> KeypointMoments:
    """Sample the tracks of a camera on a grid, and return the monomials of their keypoints."""
    period = frame_period(camera.stamps)
    values, first = [], []
    for track in camera.tracks:
        stamps = camera.stamps[track.frames]
        begin = max(0, int(np.ceil((stamps[0] - grid.start_s) / grid.step_s)))
        end = min(grid.n, int((stamps[-1] - grid.start_s) / grid.step_s) + 1)
        times: Float64Array = grid.start_s + grid.step_s * np.arange(
            begin, max(begin, end), dtype=np.float64
        )
        x = Interpolation(stamps, times, period=period)(track.x)
        values.append(_monomials(x))
        first.append(begin)
    focal = [np.nanmedian(track.focal) for track in camera.tracks]
    focal_px = float(np.median(focal)) if focal else 1.0
    return _of_values(tuple(values), np.array(first, dtype=np.int64), focal_px)


def _of_values(
    values: tuple[Float64Array, ...], first: IntArray, focal_px: float
) -> KeypointMoments:
    lengths = np.array([v.shape[1] for v in values], dtype=np.int64)
    return KeypointMoments(values, first, first + lengths, focal_px)


def _monomials(x: Float64Array) -> Float64Array:
    """Return monomials (6, F, J) of points (F, J, 2); 0 where unknown."""
    known: BoolArray = np.asarray(np.isfinite(x).all(-1))
    h = np.concatenate([np.where(known[..., None], x, 0.0), known[..., None]], -1)
    return np.stack([h[..., i] * h[..., j] for i, j in _FACTORS])


def correlate(
    a: KeypointMoments, b: KeypointMoments, *, max_lag: int
) -> Iterator[tuple[int, Float64Array]]:
    """Correlate the monomials of all tracks of two cameras at the lags ``-max_lag .. max_lag``.

    Yields
    ------
    p : int
        Index of a track of a.
    c : (Q, L, 6, 6) ndarray
        Sums over its samples k and all joints of a monomial of a at k and one of b at k + lag.
    """
    longest = max(v.shape[1] for v in a.values) + max(v.shape[1] for v in b.values)
    size = int(fft.next_fast_len(longest, real=True))
    of_b = fft.rfft(np.stack([_padded(v, size) for v in b.values]), axis=-1).transpose(0, 3, 2, 1)
    lengths = b.end - b.first
    for p, v in enumerate(a.values):
        of_a = np.conj(fft.rfft(_padded(v, size), axis=-1)).transpose(2, 0, 1)
        series = fft.irfft(of_a @ of_b, size, axis=1)
        c = np.zeros((len(lengths), 2 * max_lag + 1, N_MONOMIALS, N_MONOMIALS))
        for q, length in enumerate(lengths):
            own = int(a.first[p] - b.first[q]) - max_lag
            lags = np.arange(max(own, 1 - v.shape[1]), min(own + 2 * max_lag + 1, length))
            c[q, lags - own] = series[q, lags % size]
        yield p, c


def _padded(values: Float64Array, size: int) -> Float64Array:
    """Return (6, J, size) of (6, F, J)."""
    padded = np.pad(values, ((0, 0), (0, size - values.shape[1]), (0, 0)))
    return np.asarray(padded.transpose(0, 2, 1))


def moments_at(a: KeypointMoments, b: KeypointMoments, p: int, q: int, lag: int) -> Float64Array:
    """Return the sums (6, 6) of `correlate` of one pair of tracks at one lag."""
    begin = max(int(a.first[p]), int(b.first[q]) - lag)
    end = min(int(a.end[p]), int(b.end[q]) - lag)
    if end <= begin:
        return np.zeros((N_MONOMIALS, N_MONOMIALS))
    here = a.values[p][:, begin - a.first[p] : end - a.first[p]]
    there = b.values[q][:, begin + lag - b.first[q] : end + lag - b.first[q]]
    return np.asarray(here.reshape(N_MONOMIALS, -1) @ there.reshape(N_MONOMIALS, -1).T)


def pencil(c: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return M and N (..., 9, 9) of sums (..., 6, 6), for ``e = vec(E)``, ``x_a^T E x_b = 0``."""
    T = c[..., _SQUARE[:, :, None, None], _SQUARE]
    M = np.moveaxis(T, -3, -2)
    N = noise_of_moments(T[..., :, :, 2, 2], T[..., 2, 2, :, :])
    return np.asarray(M.reshape(*c.shape[:-2], 9, 9)), N


def noise_of_moments(here: Float64Array, there: Float64Array) -> Float64Array:
    """Return N (..., 9, 9) of the sums (..., 3, 3) of ``x_a x_a^T`` and of ``x_b x_b^T``."""
    N = here[..., :, None, :, None] * _NOISE[:, None, :]
    N = N + _NOISE[:, None, :, None] * there[..., None, :, None, :]
    return np.asarray(N.reshape(*here.shape[:-2], 9, 9))


def best_essential(M: Float64Array, N: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the two smallest mean squared Sampson distances, and the best essential matrix.

    Parameters
    ----------
    M, N : (..., 9, 9) ndarray

    Returns
    -------
    (..., 2) ndarray
        Squared distances on the plane z = 1, of the best matrix and of the next eigenvector: where
        both are small, the motion does not determine the matrix.
    (..., 3, 3) ndarray
        The matrix, which need not have the singular values of an essential one.
    """
    L = np.linalg.cholesky(M + _RIDGE * _mean_diagonal(M) * np.eye(9))
    inverse = np.linalg.inv(L)
    values, vectors = np.linalg.eigh(inverse @ N @ np.swapaxes(inverse, -1, -2))
    e = np.swapaxes(inverse, -1, -2) @ vectors[..., -1:]
    squares = 1.0 / np.maximum(values[..., :-3:-1], 1e-300)
    return squares, e.reshape(*e.shape[:-2], 3, 3)


def screening_distance(M: Float64Array, N: Float64Array) -> Float64Array:
    """Return the smallest mean squared Sampson distance (...), from below by up to 15 %.

    Much cheaper than `best_essential`: from the trace of a power of ``M^-1 N``.
    """
    B = np.linalg.solve(M + 10 * _RIDGE * _mean_diagonal(M) * np.eye(9), N)
    trace = np.trace(B, axis1=-2, axis2=-1)
    log = np.log(trace)
    for _ in range(_DOUBLINGS):
        B = B / trace[..., None, None]
        B = B @ B
        trace = np.trace(B, axis1=-2, axis2=-1)
        log = 2.0 * log + np.log(trace)
    return np.asarray(np.exp(-log / 2**_DOUBLINGS))


def mean_square(E: Float64Array, M: Float64Array, N: Float64Array) -> Float64Array:
    """Return the mean squared Sampson distance (...) of an essential matrix, or of one each."""
    e = E.reshape(*E.shape[:-2], 9)
    noise = np.einsum("...i,...ij,...j->...", e, N, e)
    return np.asarray(
        np.maximum(np.einsum("...i,...ij,...j->...", e, M, e), 0.0) / np.maximum(noise, 1e-300)
    )


def _mean_diagonal(M: Float64Array) -> Float64Array:
    return np.asarray(np.trace(M, axis1=-2, axis2=-1)[..., None, None] / M.shape[-1])
