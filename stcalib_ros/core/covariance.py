"""Uncertainty of poses and offsets, from the reduced normal equations of the adjustment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stcalib_ros.core import stba
from stcalib_ros.core.geometry import hat
from stcalib_ros.core.observations import Observations
from stcalib_ros.core.types import BoolArray, FloatArray, IntArray

PARAMETERS = ("x", "y", "z", "rot_x", "rot_y", "rot_z", "time_offset_s")
_LONGEST_SPAN = 150
_SHORTEST_SPAN = 15
_CLUSTERS_PER_UNKNOWN = 3
_VELOCITY_HALF_WINDOW = 8


def pose_covariance(o: Observations, state: stba.BundleState) -> FloatArray:
    """Joint covariance of all cameras.

    Residuals are not independent: a detector is off by the same few centimetres at a joint as
    long as it sees the person from that side. The covariance therefore is the cluster-robust
    one, ``H^-1 (sum_k u_k u_k^T) H^-1`` with the gradients u_k of everything that is seen of
    one joint of one person over five seconds or so: only these are taken as independent.

    Noise in the velocities would pass for knowledge of the offsets: here they are read over
    half a second and more.

    The gauge is the pose and clock of the reference and the length of the first baseline,
    whose rows are zero.

    Parameters
    ----------
    o : Observations
    state : BundleState
        At the optimum.

    Returns
    -------
    (7 C, 7 C) ndarray
        Per camera x, y, z of its centre, rotation about the fixed axes of the reference frame
        (rad) and offset (s).
    """
    free, _ = stba.gauge(state.t_cam_ref, synchronised=state.synchronised)
    cluster = clusters(o, state.used.sum(1) >= 2, n_unknowns=len(free))
    system, U = stba.cluster_scores(o, calmed(o, state), cluster)
    inverse = _inverse(system.H, state)
    n = U.shape[1]
    covariance = inverse @ (U @ U.T) @ inverse * n / max(n - len(free), 1)
    J = to_reference(state)
    return np.asarray(J @ covariance @ J.T)


def information_covariance(H: FloatArray, state: stba.BundleState) -> FloatArray:
    """Joint covariance, as `pose_covariance` gives it, of normal equations H (7 C, 7 C)."""
    J = to_reference(state)
    return np.asarray(J @ _inverse(H, state) @ J.T)


def _inverse(H: FloatArray, state: stba.BundleState) -> FloatArray:
    """Inverse (7 C, 7 C) of normal equations; zero where the gauge is fixed."""
    free, scale = stba.gauge(state.t_cam_ref, synchronised=state.synchronised)
    part = (H + 1e6 * np.diag(H).max() * np.outer(scale, scale))[np.ix_(free, free)]
    size = np.sqrt(np.maximum(np.diag(part), 1e-30))
    inverse = np.linalg.pinv(part / np.outer(size, size), rcond=1e-13, hermitian=True)
    out = np.zeros_like(H)
    out[np.ix_(free, free)] = inverse / np.outer(size, size)
    return out


def calmed(o: Observations, state: stba.BundleState) -> stba.BundleState:
    """The state with velocities of less noise."""
    V, A = stba.motion(o, state.X, state.used.sum(1) >= 2, half_window=_VELOCITY_HALF_WINDOW)
    return replace(state, V=V, A=A)


def clusters(o: Observations, known: BoolArray, *, n_unknowns: int) -> IntArray:
    """Number (N, J) of the cluster of each joint: of one person over a span of time.

    The span is shortened where that would leave fewer clusters of known joints than three per
    unknown.
    """
    J = o.seen.shape[2]
    span = 2 * _LONGEST_SPAN
    n = 0
    while n < _CLUSTERS_PER_UNKNOWN * n_unknowns and span > _SHORTEST_SPAN:
        span //= 2
        keys = np.stack([o.person, o.knot // span], -1)
        _, stretch = np.unique(keys, axis=0, return_inverse=True)
        number = stretch.reshape(-1, 1) * J + np.arange(J)
        occupied, found = np.unique(number[known], return_inverse=True)
        n = len(occupied)
    cluster: IntArray = np.zeros(known.shape, dtype=np.int64)
    cluster[known] = found.ravel()
    return cluster


def to_reference(state: stba.BundleState) -> FloatArray:
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
