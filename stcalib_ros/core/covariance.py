"""Uncertainty of poses and offsets, from the reduced normal equations of the adjustment."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core import stba
from stcalib_ros.core.geometry import hat
from stcalib_ros.core.observations import Observations
from stcalib_ros.core.types import FloatArray

PARAMETERS = ("x", "y", "z", "rot_x", "rot_y", "rot_z", "time_offset_s")
_MAX_INFLATION = 100.0


def pose_covariance(o: Observations, state: stba.BundleState) -> FloatArray:
    """Joint covariance of all cameras.

    The gauge is the pose and clock of the reference and the length of the first baseline,
    whose rows are zero. Residuals of neighbouring frames are not independent; the covariance
    is inflated by what their correlation takes away.

    Parameters
    ----------
    o : Observations
    state : BundleState

    Returns
    -------
    (7 C, 7 C) ndarray
        Per camera x, y, z of its centre, rotation about the fixed axes of the reference frame
        (rad) and offset (s).
    """
    system, sigma = stba.reduced_system(o, state)
    free, scale = stba.gauge(state.t_cam_ref)
    H = (system.H + 1e6 * np.diag(system.H).max() * np.outer(scale, scale))[np.ix_(free, free)]
    covariance = np.zeros_like(system.H)
    size = np.sqrt(np.maximum(np.diag(H), 1e-30))
    normalised = np.linalg.pinv(H / np.outer(size, size), rcond=1e-13, hermitian=True)
    covariance[np.ix_(free, free)] = normalised / np.outer(size, size)
    J = _to_reference(state)
    return np.asarray(J @ covariance @ J.T * sigma**2 * correlation_inflation(o, state))


def _to_reference(state: stba.BundleState) -> FloatArray:
    """Derivative of (centre, rotation in the reference frame, offset) by (rotation, t, shift)."""
    C = len(state.t_cam_ref)
    J = np.zeros((7 * C, 7 * C))
    for c, (R, t) in enumerate(zip(state.R_cam_ref, state.t_cam_ref, strict=True)):
        k = 7 * c
        J[k : k + 3, k : k + 3] = -R.T @ hat(t)
        J[k : k + 3, k + 3 : k + 6] = -R.T
        J[k + 3 : k + 6, k : k + 3] = -R.T
        J[k + 6, k + 6] = 1.0
    return J


def correlation_inflation(o: Observations, state: stba.BundleState) -> float:
    """Factor (>= 1) on the variance: ``(1 + r) / (1 - r)`` for a correlation r of next frames.

    The residuals of a few unknowns are smaller than the noise; that is allowed for by taking
    the correlation over all joints and cameras together.
    """
    residuals, used = stba.residuals_px(o, state)
    following = (np.diff(o.person) == 0) & (np.diff(o.knot) == 1)
    both = used[:-1] & used[1:] & following[:, None, None]
    if both.sum() < 100:
        return _MAX_INFLATION
    a, b = residuals[:-1][both], residuals[1:][both]
    r = float((a * b).sum() / np.sqrt((a**2).sum() * (b**2).sum()))
    return float(np.clip((1 + r) / (1 - r), 1.0, _MAX_INFLATION))
