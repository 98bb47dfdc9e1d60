"""Robust estimation: the median, and constants of two and more packages.

References
----------
P. J. Rousseeuw and C. Croux, "Alternatives to the median absolute deviation", 1993.
Z. Zhang, "Parameter estimation techniques: a tutorial with application to conic fitting", 1997.
"""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array, FloatArray

CAUCHY = 2.385
"""Ratio to the standard deviation. Scale c of the Cauchy loss ``log(1 + (r / c)^2)``. Derived: with
it, an estimate from Gaussian residuals is 95 % as efficient as least squares (Zhang, 1997)."""

RAYLEIGH_MEDIAN = 1.17741
"""Ratio. Median over sigma of the length of 2D Gaussian residuals with sigma per axis. Derived:
``sqrt(2 log 2)``, the median of the Rayleigh distribution."""

RMS_OVER_MEDIAN = 1.48
"""Ratio. Standard deviation over the median of the absolute value, for 1D Gaussian residuals.
Derived: ``1 / Phi^-1(3/4)`` = 1.4826, in two decimals."""

NOISE_MARGIN = 1.5
"""Ratio to the robust standard deviation. Scale of the Cauchy loss on epipolar distances: smaller
than `CAUCHY`, so that outliers count less, since people may be matched wrongly. Chosen on simulated
scenes of benchmarks.accuracy.level; not verified on real recordings."""

MIN_SCALE_PX = 0.5
"""Pixels. Least robust scale of reprojection errors: keypoints are rarely better, and without
noise the scale would be zero. Chosen; exact scenes only are at it."""

MIN_NOISE_PX = 3.0
"""Pixels. Least scale of epipolar distances, in registration and in monitoring. Chosen on simulated
scenes of benchmarks.accuracy.level with 3 px of noise; not verified on real recordings."""

LEAST_SHARE = 0.2
"""Ratio to the scale of all cameras. A camera's own noise is not taken to be less. Chosen on
simulated scenes of benchmarks.accuracy.level; not verified on real recordings."""


def median_of_known(
    values: FloatArray, *, least: int = 1, otherwise: float = float("inf")
) -> Float64Array:
    """Return the lower median over the last axis of the finite ones of some values.

    Parameters
    ----------
    values : (..., N) ndarray
    least : int
        How many must be finite.
    otherwise : float
        What stands where fewer are.
    """
    ordered = np.sort(np.where(np.isfinite(values), values, np.inf), axis=-1)
    count = np.isfinite(values).sum(-1)
    index = np.maximum(count - 1, 0) // 2
    middle = np.take_along_axis(ordered, index[..., None], -1)[..., 0]
    return np.where(count >= least, middle, otherwise).astype(np.float64)
