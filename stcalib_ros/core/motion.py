"""Velocities and accelerations of joint trajectories with gaps."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.types import BoolArray, FloatArray, IntArray

_ORDER = 3
_RIDGE = (1e-9, 1e-6, 1e-4, 1e-4)
"""Keeps the higher terms at zero where the window has too few samples to see them."""


def local_cubic(
    X: FloatArray, present: BoolArray, *, half_window: int = 3
) -> tuple[FloatArray, FloatArray]:
    """Savitzky-Golay fit (cubic, seven samples) of trajectories, missing samples left out.

    Parameters
    ----------
    X : (K, ..., 3) ndarray
        Positions at uniform times along the first axis; anything where not present.
    present : (K, ...) ndarray of bool
    half_window : int
        Samples to either side that are fitted.

    Returns
    -------
    velocity : (K, ..., 3) ndarray
        Per sample; zero where nothing near is present.
    acceleration : (K, ..., 3) ndarray
        Per squared sample; zero where nothing near is present.
    """
    window = np.arange(-half_window, half_window + 1)
    pad = [(half_window, half_window)] + [(0, 0)] * (X.ndim - 1)
    padded = np.pad(np.where(present[..., None], X, 0.0), pad)
    there = np.pad(present, pad[:-1])
    shifted = [slice(i, i + len(X)) for i in range(len(window))]
    n = np.sum([there[s] for s in shifted], axis=0)
    kernels = np.linalg.pinv(window[:, None].astype(float) ** np.arange(_ORDER + 1))[1:3]
    velocity, acceleration = (
        np.sum([k * padded[s] for k, s in zip(kernel, shifted, strict=True)], axis=0)
        for kernel in (kernels[0], 2.0 * kernels[1])
    )
    gappy = (n > 0) & (n < len(window))
    velocity[n == 0] = acceleration[n == 0] = 0.0
    if gappy.any():
        values = np.stack([padded[s][gappy] for s in shifted], 1)
        known = np.stack([there[s][gappy] for s in shifted], 1)
        velocity[gappy], acceleration[gappy] = _ridge_fit(values, known, window)
    return velocity, acceleration


def _ridge_fit(
    values: FloatArray, known: BoolArray, window: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Slope and curvature (M, 3) in the middle of windows (M, W, 3) with missing samples."""
    powers = window[:, None].astype(float) ** np.arange(_ORDER + 1)
    A = np.einsum("mw,wa,wb->mab", known.astype(float), powers, powers, optimize=True)
    b = np.einsum("mwx,wa->max", values, powers, optimize=True)
    coefficients = np.linalg.solve(A + np.diag(_RIDGE), b)
    return coefficients[:, 1], 2.0 * coefficients[:, 2]
