"""Von Mises-Fisher distributions on the unit sphere (Section III-B).

``f(v; mu, kappa) = C(kappa) exp(kappa mu^T v)`` with ``C(kappa) = kappa / (4 pi sinh kappa)``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array

_MAX_KAPPA = 1e4
"""Half a degree: five frames that agree better by chance say no more."""
_NEWTON_STEPS = 4
_MIN_SAMPLES = 2


@dataclass(frozen=True, slots=True, eq=False)
class VonMisesFisher:
    """Any number of distributions at once.

    Attributes
    ----------
    mu : (..., 3) ndarray
        Mean directions; zero where `kappa` is.
    kappa : (...) ndarray
        Concentrations; zero, the uniform distribution, where too little was seen.
    """

    mu: Float64Array
    kappa: Float64Array

    def log_density(self, v: Float64Array) -> Float64Array:
        """``log f(v)`` of directions (..., 3)."""
        return np.asarray(log_normaliser(self.kappa) + self.kappa * (self.mu * v).sum(-1))


def mean_resultant_length(kappa: Float64Array) -> Float64Array:
    """Length of the mean of the distribution, ``A_3(kappa) = coth(kappa) - 1 / kappa``."""
    kappa = np.asarray(kappa, dtype=np.float64)
    small = kappa < 1e-3
    safe = np.where(small, 1.0, kappa)
    return np.asarray(np.where(small, kappa / 3.0, 1.0 / np.tanh(safe) - 1.0 / safe))


def log_normaliser(kappa: Float64Array) -> Float64Array:
    """``log C(kappa)``, without overflow; ``-log 4 pi`` at zero."""
    kappa = np.asarray(kappa, dtype=np.float64)
    small = kappa < 1e-6
    safe = np.where(small, 1.0, kappa)
    log_sinh = safe + np.log1p(-np.exp(-2.0 * safe)) - np.log(2.0)
    return np.asarray(np.where(small, 0.0, np.log(safe) - log_sinh) - np.log(4.0 * np.pi))


def fit(resultant: Float64Array, count: Float64Array) -> VonMisesFisher:
    """Maximum likelihood estimate of distributions from sums of directions.

    mu is the direction of the sum; kappa solves ``A_3(kappa) = |sum| / n`` by Newton's method
    from the approximation ``R (3 - R^2) / (1 - R^2)`` of Banerjee et al. (2005).

    Parameters
    ----------
    resultant : (..., 3) ndarray
        Sums of unit vectors.
    count : (...) ndarray
        How many each sum has; with fewer than two nothing is known.
    """
    length = np.linalg.norm(resultant, axis=-1)
    known = (count >= _MIN_SAMPLES) & (length > 0)
    mean = np.where(known, length / np.maximum(count, 1.0), 0.0)
    mean = np.minimum(mean, mean_resultant_length(np.array(_MAX_KAPPA)))
    kappa = mean * (3.0 - mean**2) / (1.0 - mean**2)
    for _ in range(_NEWTON_STEPS):
        error = mean_resultant_length(kappa) - mean
        kappa = np.clip(kappa - error / _slope(kappa), 0.0, _MAX_KAPPA)
    mu = np.where(known[..., None], resultant / np.maximum(length, 1e-300)[..., None], 0.0)
    return VonMisesFisher(mu, np.where(known, kappa, 0.0))


def _slope(kappa: Float64Array) -> Float64Array:
    """Derivative of `mean_resultant_length`, ``1 / kappa^2 - 1 / sinh^2 kappa``."""
    small = kappa < 1e-2
    safe = np.clip(kappa, 1e-2, 300.0)
    return np.where(small, 1.0 / 3.0, 1.0 / np.maximum(kappa, 1e-2) ** 2 - np.sinh(safe) ** -2.0)
