"""Uncertainty of poses and offsets, from the reduced normal equations of the adjustment."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.bundle.levenberg_marquardt import cluster_scores, gauge
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.offset_debiasing import velocity_noise
from stcalib_ros.core.bundle.residuals import errors_px, robust_scale
from stcalib_ros.core.bundle.state import BundleState
from stcalib_ros.core.geometry.robust import CAUCHY, MIN_SCALE_PX
from stcalib_ros.core.geometry.so3 import hat
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray

PARAMETERS = ("x", "y", "z", "rot_x", "rot_y", "rot_z", "time_offset_s")
_LONGEST_SPAN = 150
_SHORTEST_SPAN = 15
_CLUSTERS_PER_UNKNOWN = 3


def pose_covariance(o: Observations, state: BundleState) -> Float64Array:
    """Joint covariance of all cameras.

    That of the normal equations, what is noise in the velocities taken off, times one variance for
    all. A detector is off by the same few centimetres at a joint as long as it sees the person from
    that side: the gradients u_k of everything that is seen of one joint of one person over five
    seconds or so count as independent, and the variance is their ``sum_k u_k^T H^-1 u_k`` per
    unknown. A full covariance from the u_k would be too small: there are too few of them.

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
    free, _ = gauge(state.t_cam_ref, synchronised=state.synchronised)
    cluster = clusters(o, state.used.sum(1) >= 2, n_unknowns=len(free))
    system, U = cluster_scores(o, state, cluster)
    found = float(np.einsum("an,ab,bn", U, _inverse(system.H, state), U, optimize=True))
    errors = errors_px(o, state)
    scale = CAUCHY * max(robust_scale(errors, state.used), MIN_SCALE_PX)
    variance = found / (len(free) - 1) * _curvature_lost(errors[state.used], scale) ** 2
    if not state.synchronised:
        noise = velocity_noise(o, state, scale)
        system = noise.subtract_from(system, state.shift_s)
    return information_covariance(system.H / variance, state)


def _curvature_lost(errors: Float64Array, scale: float) -> float:
    """How much flatter the robust cost is than its weights make the normal equations.

    A weight ``w = 1 / (1 + r^2 / s^2)`` stands for a mean second derivative of w^2 in the plane.
    """
    weight = 1.0 / (1.0 + (errors[np.isfinite(errors)] / scale) ** 2)
    return float(weight.mean() / (weight**2).mean())


def information_covariance(H: Float64Array, state: BundleState) -> Float64Array:
    """Joint covariance, as `pose_covariance` gives it, of normal equations H (7 C, 7 C)."""
    J = to_reference(state)
    return np.asarray(J @ _inverse(H, state) @ J.T)


def _inverse(H: Float64Array, state: BundleState) -> Float64Array:
    """Inverse (7 C, 7 C) of normal equations; zero where the gauge is fixed."""
    free, scale = gauge(state.t_cam_ref, synchronised=state.synchronised)
    part = (H + 1e6 * np.diag(H).max() * np.outer(scale, scale))[np.ix_(free, free)]
    size = np.sqrt(np.maximum(np.diag(part), 1e-30))
    inverse = np.linalg.pinv(part / np.outer(size, size), rcond=1e-13, hermitian=True)
    out = np.zeros_like(H)
    out[np.ix_(free, free)] = inverse / np.outer(size, size)
    return out


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


def to_reference(state: BundleState) -> Float64Array:
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
