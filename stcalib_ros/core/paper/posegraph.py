"""Pose graph optimisation on SE(3) over all pairs of cameras (Section IV).

Minimises ``sum |log(T_ab^-1 T_a^-1 T_b)|^2`` over the poses T_a of the cameras, with T_ab from
the registration of each pair. Twists are (translation, rotation); poses are changed on the right.

References
----------
T. D. Barfoot, *State Estimation for Robotics*, Cambridge University Press, 2017, chapters 7 and 9.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stcalib_ros.core.geometry.graphs import spanning_tree
from stcalib_ros.core.geometry.se3 import adjoint, exp_se3, inverse, log_se3, right_jacobian_inverse
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.paper.limits import POSE_STDDEV

_STDDEV = np.repeat(POSE_STDDEV, 3)
"""Standard deviations (m, rad) of a twist, see `limits.POSE_STDDEV`."""
_MAX_ITERATIONS = 30
"""Gauss-Newton steps at most; pose graphs of a few cameras converge in far fewer."""
_CONVERGED = 1e-10
"""Largest entry of a twist (m, rad) below which the iteration has converged, near rounding."""
_SHORTEST_STEP = 1e-3
"""Fraction of a Gauss-Newton step at which shortening it ends: nothing is gained along it."""


def optimise(
    cameras: Sequence[int], edges: Sequence[RelativePose], *, synchronised: bool = False
) -> Rig:
    """Estimate one rig from all pairs; the first camera is its reference.

    Time offsets, which the paper leaves to the pairs, are the least squares solution of all lags.

    Parameters
    ----------
    cameras : sequence of int
        Cameras connected by the edges.
    edges : sequence of RelativePose
        Relative pose of each pair that could be registered.
    synchronised : bool
        Value of `Rig.synchronised`.
    """
    node = {c: i for i, c in enumerate(cameras)}
    a = np.array([node[h.a] for h in edges])
    b = np.array([node[h.b] for h in edges])
    T_a_b = np.stack([_pose(h.R_a_b, h.t_a_b) for h in edges])
    support = np.array([h.support for h in edges])
    T = _along_tree(a, b, T_a_b, support, len(cameras))
    T = optimise_poses(a, b, T_a_b, T)
    lags = np.array([h.lag_s for h in edges])
    return Rig(
        cameras=np.array(cameras, dtype=np.int64),
        R_ref_cam=T[:, :3, :3],
        t_ref_cam=T[:, :3, 3],
        offset_s=_offsets(a, b, lags, len(cameras)),
        support=float(support.sum()),
        synchronised=synchronised,
    )


def _pose(R: Float64Array, t: Float64Array) -> Float64Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


def _along_tree(
    a: IntArray, b: IntArray, T_a_b: Float64Array, support: Float64Array, n: int
) -> Float64Array:
    """Chain the poses (n, 4, 4) along the spanning tree of the best supported pairs."""
    T = np.tile(np.eye(4), (n, 1, 1))
    for e, forward in spanning_tree(a, b, np.argsort(-support, kind="stable"), n):
        if forward:
            T[b[e]] = T[a[e]] @ T_a_b[e]
        else:
            T[a[e]] = T[b[e]] @ inverse(T_a_b[e])
    return T


def optimise_poses(a: IntArray, b: IntArray, T_a_b: Float64Array, T: Float64Array) -> Float64Array:
    """Optimize the poses T (n, 4, 4) by Gauss-Newton with a line search.

    Parameters
    ----------
    a, b : (E,) ndarray of int
    T_a_b : (E, 4, 4) ndarray
        ``x_a = T_a_b x_b``.
    T : (n, 4, 4) ndarray
        ``T_ref_a``; the first stays as it is.
    """
    if len(T) < 2:
        return T
    cost = _cost(a, b, T_a_b, T)
    for _ in range(_MAX_ITERATIONS):
        step = _gauss_newton(a, b, T_a_b, T)
        length = 1.0
        while _cost(a, b, T_a_b, T @ exp_se3(length * step)) > cost and length > _SHORTEST_STEP:
            length /= 2.0
        trial = T @ exp_se3(length * step)
        gain = cost - _cost(a, b, T_a_b, trial)
        if gain <= 0:
            break
        T, cost = trial, cost - gain
        if np.abs(step).max() < _CONVERGED:
            break
    return T


def _gauss_newton(a: IntArray, b: IntArray, T_a_b: Float64Array, T: Float64Array) -> Float64Array:
    """Return the twists (n, 6) of one step; zero for the first pose."""
    n = len(T)
    r = log_se3(inverse(T_a_b) @ inverse(T[a]) @ T[b])
    J_b = right_jacobian_inverse(r)
    J_a = -J_b @ adjoint(inverse(T[b]) @ T[a])
    J = np.zeros((len(r), 6, n, 6))
    rows = np.arange(len(r))
    J[rows, :, a] += J_a
    J[rows, :, b] += J_b
    J /= _STDDEV[:, None, None]
    flat = J.reshape(-1, 6 * n)[:, 6:]
    step = np.zeros(6 * n)
    step[6:] = np.linalg.lstsq(flat, -(r / _STDDEV).ravel(), rcond=None)[0]
    return step.reshape(n, 6)


def _cost(a: IntArray, b: IntArray, T_a_b: Float64Array, T: Float64Array) -> float:
    r = log_se3(inverse(T_a_b) @ inverse(T[a]) @ T[b]) / _STDDEV
    return float((r**2).sum())


def _offsets(a: IntArray, b: IntArray, lag_s: Float64Array, n: int) -> Float64Array:
    """Solve ``offset_a - offset_b = lag`` for offsets (n,) in least squares, the first one zero."""
    rows = np.arange(len(lag_s))
    B = np.zeros((len(lag_s), n))
    B[rows, a] += 1.0
    B[rows, b] -= 1.0
    offset = np.zeros(n)
    offset[1:] = np.linalg.lstsq(B[:, 1:], lag_s, rcond=None)[0]
    return offset
