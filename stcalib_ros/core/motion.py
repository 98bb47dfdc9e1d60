"""Smoothed positions and velocities of joint trajectories with gaps."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.types import BoolArray, FloatArray

_HALF_WINDOW = 3
_ORDER = 3
_RIDGE = (0.0, 1e-6, 1e-4, 1e-4)
"""Keeps the higher terms at zero where the window has too few samples to see them."""


def local_cubic(X: FloatArray, present: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Savitzky-Golay fit (seven samples, cubic) of trajectories, missing samples left out.

    Parameters
    ----------
    X : (K, ..., 3) ndarray
        Positions at uniform times along the first axis; anything where not present.
    present : (K, ...) ndarray of bool

    Returns
    -------
    velocity : (K, ..., 3) ndarray
        Displacement per sample; zero where nothing near is present.
    smooth : (K, ..., 3) ndarray
        Fitted positions.
    """
    K = len(X)
    w = present.astype(float)
    wX = np.where(present[..., None], X, 0.0)
    moments = np.zeros((2 * _ORDER + 1, *w.shape))
    right = np.zeros((_ORDER + 1, *wX.shape))
    for i in range(-_HALF_WINDOW, _HALF_WINDOW + 1):
        here = slice(max(0, -i), K - max(0, i))
        there = slice(max(0, i), K - max(0, -i))
        for order in range(2 * _ORDER + 1):
            moments[order][here] += float(i) ** order * w[there]
        for order in range(_ORDER + 1):
            right[order][here] += float(i) ** order * wX[there]
    A = moments[np.add.outer(range(_ORDER + 1), range(_ORDER + 1))]
    A = np.moveaxis(A, (0, 1), (-2, -1))
    A = A + np.diag(_RIDGE) + np.where(w.any() & (A[..., :1, :1] > 0), 0.0, np.eye(_ORDER + 1))
    coefficients = np.linalg.solve(A, np.moveaxis(right, 0, -2))
    return coefficients[..., 1, :], coefficients[..., 0, :]
