"""Von Mises-Fisher distributions on the unit sphere (Section III-B).

``f(v; mu, kappa) = C(kappa) exp(kappa mu^T v)`` with ``C(kappa) = kappa / (4 pi sinh kappa)``.

References
----------
A. Banerjee, I. S. Dhillon, J. Ghosh, S. Sra, "Clustering on the unit hypersphere using von
Mises-Fisher distributions", Journal of Machine Learning Research 6, 2005, pp. 1345-1382.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.paper.limits import MAX_KAPPA, MIN_SAMPLES

_NEWTON_STEPS = 4
"""Newton steps for kappa; from the approximation of Banerjee et al. they reach rounding."""
_SMALL_MEAN = 1e-3
"""Kappa below which the series ``kappa / 3`` replaces ``coth(kappa) - 1 / kappa``: the next term is
kappa^3 / 45, and the difference would lose nine digits."""
_SMALL_NORMALISER = 1e-6
"""Kappa below which ``kappa / sinh kappa`` is 1 to rounding."""
_SMALL_SLOPE = 1e-2
"""Kappa below which the slope is 1/3: the next term is kappa^2 / 15, and Newton's method does not
need it."""
_MAX_SINH = 300.0
"""Kappa above which ``1 / sinh^2 kappa`` is 0 to rounding; sinh overflows at 710."""
_MIN_LENGTH = 1e-300
"""Length of a sum of directions; keeps an empty sum from dividing by zero."""


@dataclass(frozen=True, slots=True, eq=False)
class VonMisesFisher:
    """Any number of distributions at once.

    Attributes
    ----------
    mu : (..., 3) ndarray
        Mean directions; zero where `kappa` is.
    kappa : (...) ndarray
        Concentrations; zero, the uniform distribution, where too little was observed.
    """

    mu: Float64Array
    kappa: Float64Array


def mean_resultant_length(kappa: Float64Array) -> Float64Array:
    """Return the length of the mean direction, ``A_3(kappa) = coth(kappa) - 1 / kappa``."""
    kappa = np.asarray(kappa, dtype=np.float64)
    small = kappa < _SMALL_MEAN
    safe = np.where(small, 1.0, kappa)
    return np.asarray(np.where(small, kappa / 3.0, 1.0 / np.tanh(safe) - 1.0 / safe))


def log_normaliser(kappa: Float64Array) -> Float64Array:
    """Return ``log C(kappa)`` without overflow; ``-log 4 pi`` at zero."""
    kappa = np.asarray(kappa, dtype=np.float64)
    small = kappa < _SMALL_NORMALISER
    safe = np.where(small, 1.0, kappa)
    log_sinh = safe + np.log1p(-np.exp(-2.0 * safe)) - np.log(2.0)
    return np.asarray(np.where(small, 0.0, np.log(safe) - log_sinh) - np.log(4.0 * np.pi))


def fit(resultant: Float64Array, count: Float64Array) -> VonMisesFisher:
    """Estimate distributions from sums of directions by maximum likelihood.

    mu is the direction of the sum; kappa solves ``A_3(kappa) = |sum| / n`` by Newton's method
    from the approximation ``R (3 - R^2) / (1 - R^2)`` of Banerjee et al. (2005).

    Parameters
    ----------
    resultant : (..., 3) ndarray
        Sums of unit vectors.
    count : (...) ndarray
        Number of vectors in each sum; with fewer than `limits.MIN_SAMPLES` kappa is 0.
    """
    length = np.linalg.norm(resultant, axis=-1)
    known = (count >= MIN_SAMPLES) & (length > 0)
    mean = np.where(known, length / np.maximum(count, 1.0), 0.0)
    mean = np.minimum(mean, mean_resultant_length(np.array(MAX_KAPPA)))
    kappa = mean * (3.0 - mean**2) / (1.0 - mean**2)
    for _ in range(_NEWTON_STEPS):
        error = mean_resultant_length(kappa) - mean
        kappa = np.clip(kappa - error / _slope(kappa), 0.0, MAX_KAPPA)
    mu = np.where(known[..., None], resultant / np.maximum(length, _MIN_LENGTH)[..., None], 0.0)
    return VonMisesFisher(mu, np.where(known, kappa, 0.0))


def _slope(kappa: Float64Array) -> Float64Array:
    """Return the derivative of `mean_resultant_length`, ``1 / kappa^2 - 1 / sinh^2 kappa``."""
    small = kappa < _SMALL_SLOPE
    safe = np.clip(kappa, _SMALL_SLOPE, _MAX_SINH)
    return np.where(
        small, 1.0 / 3.0, 1.0 / np.maximum(kappa, _SMALL_SLOPE) ** 2 - np.sinh(safe) ** -2.0
    )
