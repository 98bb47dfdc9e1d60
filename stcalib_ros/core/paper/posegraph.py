"""Pose graph optimisation on SE(3) over all pairs of cameras (Section IV).

Minimises ``sum |log(T_ab^-1 T_a^-1 T_b)|^2`` over the poses T_a of the cameras, with T_ab from
the registration of each pair. Twists are (translation, rotation); poses are changed on the right.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stcalib_ros.core.averaging import Rig, spanning_tree
from stcalib_ros.core.geometry import exp_so3, hat, log_so3
from stcalib_ros.core.hypotheses import PairHypothesis
from stcalib_ros.core.types import FloatArray, IntArray

_STDDEV = np.repeat([0.3, 0.06], 3)
"""Metres and rad by which the registration of a pair is off; the same for all pairs."""
_MAX_ITERATIONS = 30
_CONVERGED = 1e-10


def optimise(
    cameras: Sequence[int], edges: Sequence[PairHypothesis], *, synchronised: bool = False
) -> Rig:
    """One rig from all pairs, the first camera its reference.

    Offsets, which the paper leaves to the pairs, are the least squares of all lags.

    Parameters
    ----------
    cameras : sequence of int
        Connected by the edges.
    edges : sequence of PairHypothesis
        One of each pair that could be registered.
    synchronised : bool
        For the record.
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
        np.array(cameras, dtype=np.int64),
        T[:, :3, :3],
        T[:, :3, 3],
        _offsets(a, b, lags, len(cameras)),
        float(support.sum()),
        synchronised,
    )


def _pose(R: FloatArray, t: FloatArray) -> FloatArray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


def _along_tree(
    a: IntArray, b: IntArray, T_a_b: FloatArray, support: FloatArray, n: int
) -> FloatArray:
    """Poses (n, 4, 4) chained along the spanning tree of the best supported pairs."""
    T = np.tile(np.eye(4), (n, 1, 1))
    for e, forward in spanning_tree(a, b, np.argsort(-support, kind="stable"), n):
        if forward:
            T[b[e]] = T[a[e]] @ T_a_b[e]
        else:
            T[a[e]] = T[b[e]] @ inverse(T_a_b[e])
    return T


def optimise_poses(a: IntArray, b: IntArray, T_a_b: FloatArray, T: FloatArray) -> FloatArray:
    """Gauss-Newton from the poses T (n, 4, 4); steps that do not help are shortened.

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
        while _cost(a, b, T_a_b, T @ exp_se3(length * step)) > cost and length > 1e-3:
            length /= 2.0
        trial = T @ exp_se3(length * step)
        gain = cost - _cost(a, b, T_a_b, trial)
        if gain <= 0:
            break
        T, cost = trial, cost - gain
        if np.abs(step).max() < _CONVERGED:
            break
    return T


def _gauss_newton(a: IntArray, b: IntArray, T_a_b: FloatArray, T: FloatArray) -> FloatArray:
    """Twists (n, 6) of one step; zero for the first pose."""
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


def _cost(a: IntArray, b: IntArray, T_a_b: FloatArray, T: FloatArray) -> float:
    r = log_se3(inverse(T_a_b) @ inverse(T[a]) @ T[b]) / _STDDEV
    return float((r**2).sum())


def _offsets(a: IntArray, b: IntArray, lag_s: FloatArray, n: int) -> FloatArray:
    """Offsets (n,) with ``offset_a - offset_b = lag`` in least squares, the first one zero."""
    rows = np.arange(len(lag_s))
    B = np.zeros((len(lag_s), n))
    B[rows, a] += 1.0
    B[rows, b] -= 1.0
    offset = np.zeros(n)
    offset[1:] = np.linalg.lstsq(B[:, 1:], lag_s, rcond=None)[0]
    return offset


def inverse(T: FloatArray) -> FloatArray:
    """Inverse poses (..., 4, 4)."""
    out = np.zeros_like(T)
    R_t = np.swapaxes(T[..., :3, :3], -1, -2)
    out[..., :3, :3] = R_t
    out[..., :3, 3] = -np.einsum("...ij,...j->...i", R_t, T[..., :3, 3])
    out[..., 3, 3] = 1.0
    return out


def exp_se3(xi: FloatArray) -> FloatArray:
    """Poses (..., 4, 4) of twists (..., 6)."""
    rho, phi = xi[..., :3], xi[..., 3:]
    first, second, _, _ = _coefficients(phi)
    P = hat(phi)
    V = np.eye(3) + first * P + second * (P @ P)
    T = np.zeros((*xi.shape[:-1], 4, 4))
    T[..., :3, :3] = exp_so3(phi)
    T[..., :3, 3] = np.einsum("...ij,...j->...i", V, rho)
    T[..., 3, 3] = 1.0
    return T


def log_se3(T: FloatArray) -> FloatArray:
    """Twists (..., 6) of poses (..., 4, 4)."""
    phi = log_so3(T[..., :3, :3])
    rho = np.einsum("...ij,...j->...i", _left_jacobian_inverse(phi), T[..., :3, 3])
    return np.concatenate([rho, phi], -1)


def adjoint(T: FloatArray) -> FloatArray:
    """Matrices (..., 6, 6) with ``T exp(xi) T^-1 = exp(Ad xi)``."""
    R = T[..., :3, :3]
    out = np.zeros((*T.shape[:-2], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = R
    out[..., :3, 3:] = hat(T[..., :3, 3]) @ R
    return out


def right_jacobian_inverse(xi: FloatArray) -> FloatArray:
    """Derivative (..., 6, 6) of ``log(exp(xi) exp(d))`` by d at zero (Barfoot, 7.95)."""
    inverse_block = _left_jacobian_inverse(-xi[..., 3:])
    out = np.zeros((*xi.shape[:-1], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = inverse_block
    out[..., :3, 3:] = -inverse_block @ _coupling(-xi) @ inverse_block
    return out


def _left_jacobian_inverse(phi: FloatArray) -> FloatArray:
    theta = np.linalg.norm(phi, axis=-1)[..., None, None]
    small = theta < 1e-3
    safe = np.where(small, 1.0, theta)
    second = np.where(small, 1.0 / 12.0, (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)
    P = hat(phi)
    return np.asarray(np.eye(3) - 0.5 * P + second * (P @ P))


def _coupling(xi: FloatArray) -> FloatArray:
    """Off-diagonal block (..., 3, 3) of the left Jacobian of SE(3) (Barfoot, 7.86b)."""
    rho, phi = hat(xi[..., :3]), hat(xi[..., 3:])
    _, c1, c2, c3 = _coefficients(xi[..., 3:])
    prp = phi @ rho @ phi
    return np.asarray(
        0.5 * rho
        + c1 * (phi @ rho + rho @ phi + prp)
        + c2 * (phi @ phi @ rho + rho @ phi @ phi - 3.0 * prp)
        + c3 * (prp @ phi + phi @ prp)
    )


def _coefficients(phi: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """(1 - cos) / t^2, (t - sin) / t^3, and the third and fourth of Barfoot's 7.86b."""
    t = np.linalg.norm(phi, axis=-1)[..., None, None]
    small = t < 0.1
    s = np.where(small, 1.0, t)
    sine, cosine, t2 = np.sin(s), np.cos(s), t**2
    exact = (
        (1.0 - cosine) / s**2,
        (s - sine) / s**3,
        (0.5 * s**2 + cosine - 1.0) / s**4,
        0.5 * (2.0 * s - 3.0 * sine + s * cosine) / s**5,
    )
    series = (
        0.5 - t2 / 24.0 + t2**2 / 720.0,
        1.0 / 6.0 - t2 / 120.0 + t2**2 / 5040.0,
        1.0 / 24.0 - t2 / 720.0 + t2**2 / 40320.0,
        1.0 / 120.0 - t2 / 2520.0 + t2**2 / 120960.0,
    )
    first, second, third, fourth = (
        np.where(small, b, a) for a, b in zip(exact, series, strict=True)
    )
    return first, second, third, fourth
