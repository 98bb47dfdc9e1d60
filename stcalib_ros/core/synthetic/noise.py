"""Smooth random functions of time: what errors of trackers and lifters look like."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from stcalib_ros.core.model.arrays import Float64Array

_SAMPLES_PER_TAU = 4
"""Samples per correlation time of the grid that is interpolated. Numerical."""


def child_rng(rng: np.random.Generator) -> np.random.Generator:
    """Independent generator, so that one part drawing more does not change the others."""
    return np.random.default_rng(rng.integers(2**63, size=4))


def smooth_noise(
    rng: np.random.Generator, times: Float64Array, shape: tuple[int, ...], tau_s: float
) -> Float64Array:
    """Stationary Gaussian processes of zero mean and unit variance.

    Parameters
    ----------
    rng : Generator
    times : (T,) ndarray
        Seconds, increasing.
    shape : tuple of int
        Independent processes.
    tau_s : float
        The correlation at a lag d is ``exp(-d**2 / (4 tau_s**2))``.

    Returns
    -------
    (T, *shape) ndarray
    """
    if len(times) == 0:
        return np.zeros((0, *shape))
    step = tau_s / _SAMPLES_PER_TAU
    n = int(np.ceil((times[-1] - times[0]) / step)) + 2
    pad = 4 * _SAMPLES_PER_TAU
    white = rng.standard_normal((n + 2 * pad, int(np.prod(shape, dtype=int))))
    grid = gaussian_filter1d(white, _SAMPLES_PER_TAU, axis=0, truncate=4.0)[pad : pad + n]
    position = (times - times[0]) / step
    low = position.astype(int)
    weight = (position - low)[:, None]
    out: Float64Array = (1 - weight) * grid[low] + weight * grid[low + 1]
    return (out / _kernel_norm()).reshape(len(times), *shape)


def _kernel_norm() -> float:
    impulse = np.zeros(8 * _SAMPLES_PER_TAU + 1)
    impulse[4 * _SAMPLES_PER_TAU] = 1.0
    return float(np.linalg.norm(gaussian_filter1d(impulse, _SAMPLES_PER_TAU, truncate=4.0)))
