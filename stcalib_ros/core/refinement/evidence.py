"""Variances of priors by the largest marginal likelihood."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array


def renewed_variance(squares: Float64Array, determined: Float64Array, least: float) -> Float64Array:
    """Estimate the variance of a zero-mean Gaussian prior by MacKay's fixed point, one step.

    Parameters
    ----------
    squares : ndarray
        Sums of the squares of the estimates that have the prior, one for each prior.
    determined : ndarray
        Numbers of these that the data determine: the sum of ``1 - posterior / prior variance``.
    least : float
        Smallest variance.

    References
    ----------
    D. J. C. MacKay, "Bayesian interpolation", Neural Computation 4 (1992), eq. 4.7.
    """
    return np.maximum(squares / np.maximum(determined, 1e-9), least)
