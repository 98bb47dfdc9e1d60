"""The normal equations of the bundle adjustment, the points eliminated block by block.

A block is a few thousand points: what belongs to its points fits into the cache and is
forgotten when its part of the reduced system has been added up, so that memory does not grow
with the length of the recording.

With ``y = R X(t)`` and ``u`` the projection of ``y + t``, both Jacobians of an image point are
the same 2x3 matrix A times something simple: ``A [-y x, I, R V]`` for the camera, ``A R`` for the
joint. All sums are therefore made of ``M = w A^T A``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.parameters import (
    ROTATION,
    TIME_OFFSET,
    TRANSLATION,
    Cameras,
    CameraUnknown,
    ParameterLayout,
)
from stcalib_ros.core.bundle.point_views import PointTimes
from stcalib_ros.core.bundle.residuals import Projection
from stcalib_ros.core.geometry.so3 import hat
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class ReducedSystem:
    """Normal equations of the cameras after the points are eliminated.

    Attributes
    ----------
    H : (n, n) ndarray
        In the order of a `ParameterLayout`.
    g : (n,) ndarray
    """

    H: Float64Array
    g: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class BackSubstitution:
    """What the points of a block need to follow the cameras: L, ``L^-1 g`` (3, P)."""

    factors: tuple[Float64Array, ...]
    z: Float64Array


class Block:
    """Image points of some rows: arrays over (camera, component, point), points contiguous.

    Parameters
    ----------
    obs : Observations
    inlier : (N, C, J) ndarray of bool
        Image points that take part.
    V, A : (N, J, 3) ndarray
        Velocities and accelerations.
    rows : slice
    """

    def __init__(
        self, obs: Observations, used: BoolArray, V: Float64Array, A: Float64Array, rows: slice
    ) -> None:
        n, C, J = used[rows].shape
        mask = used[rows].transpose(1, 0, 2).reshape(C, n * J)
        inside = mask.sum(0) >= 2
        keep: slice | IntArray = slice(None) if inside.all() else np.flatnonzero(inside)
        self.mask = mask[:, keep]
        self.points: IntArray = rows.start * J + np.flatnonzero(inside)
        self.x = obs.x[rows].transpose(1, 3, 0, 2).reshape(C, 2, n * J)[:, :, keep]
        focal = obs.focal[rows].transpose(1, 0, 2).reshape(C, n * J)[:, keep]
        self.focal: Float64Array = focal * self.mask
        elapsed = np.broadcast_to(obs.elapsed(rows), (n, C, J))
        self.phi = elapsed.transpose(1, 0, 2).reshape(C, n * J)[:, keep]
        row = (
            None if obs.row is None else obs.row[rows].transpose(1, 0, 2).reshape(C, n * J)[:, keep]
        )
        since = np.repeat(obs.since_middle(rows), J)[keep]
        self.times = PointTimes(since, np.zeros((1, 1)) if row is None else row)
        self.V = V[rows].reshape(-1, 3)[keep].T
        self.A = A[rows].reshape(-1, 3)[keep].T

    def at(
        self, cameras: Cameras, X: Float64Array, layout: ParameterLayout | None = None
    ) -> Linearisation:
        """Keypoints predicted for joints X (P, 3); default layout: poses and time offsets."""
        return Linearisation(self, cameras, X.T, layout or ParameterLayout(len(cameras.t)))


class Linearisation(Projection):
    """Predictions and residuals of a block, and the sums that follow from them."""

    def __init__(
        self, block: Block, cameras: Cameras, X: Float64Array, layout: ParameterLayout
    ) -> None:
        self.block, self.X, self.layout = block, X, layout
        self._displacements: dict[CameraUnknown, Float64Array] = {}
        R = cameras.R
        when = (block.phi + cameras.delay(block.times))[:, None]
        half = when * (0.5 * R @ block.A)
        velocity = R @ block.V + half
        y = R @ X + when * velocity
        velocity += half
        super().__init__(cameras, y, velocity, block.times, block.x, block.focal)

    def reduce(
        self, scale: float, damping: float
    ) -> tuple[ReducedSystem, Float64Array, BackSubstitution, Float64Array]:
        """Eliminate the points.

        Returns
        -------
        system : ReducedSystem
            Without damping of the cameras.
        diagonal : (n,) ndarray
            Of the camera block before the elimination: what damping multiplies.
        eliminated : BackSubstitution
        T : (3, n, P) ndarray
            ``L^-1 W^T``.
        """
        m, q = self.weighted(scale)
        (C, P), n = m.shape, self.layout.block
        N = self._camera_rows(m)
        H_cc = self._camera_block(N)
        R_T = np.swapaxes(self.cameras.R, -1, -2)
        T = np.empty_like(N)
        flat = (one.reshape(3, C, n * P).transpose(1, 0, 2) for one in (N, T))
        source, target = flat
        np.matmul(R_T, source, out=target)
        H_pp = self._point_block(T)
        factors = cholesky3(H_pp, damping)
        T = forward_solve(factors, T).reshape(3, C * n, P)
        z = forward_solve(factors, (R_T @ q).sum(0))
        H = -(T[0] @ T[0].T) - T[1] @ T[1].T - T[2] @ T[2].T
        for c in range(C):
            block = self.layout.of_camera(c)
            H[block, block] += H_cc[c]
        g = self._gradients(q).sum(-1).ravel() - sum(T[k] @ z[k] for k in range(3))
        diagonal = H_cc[:, range(n), range(n)].ravel()
        return ReducedSystem(H, g), diagonal, BackSubstitution(factors, z), T

    def scores(self, scale: float) -> tuple[ReducedSystem, Float64Array]:
        """The system without damping, and the reduced gradients (n, P) of the single points."""
        system, _, eliminated, T = self.reduce(scale, 0.0)
        _, q = self.weighted(scale)
        direct = self._gradients(q).reshape(T.shape[1:])
        return system, np.asarray(direct - np.einsum("kap,kp->ap", T, eliminated.z))

    def by_time(
        self, scale: float, V: Float64Array | None = None
    ) -> tuple[Float64Array, Float64Array, Float64Array]:
        """What the points say about the time of each camera's image, poses given.

        Parameters
        ----------
        scale : float
        V : (3, P) ndarray, optional
            Other velocities than those of the points.

        Returns
        -------
        h : (C, P) ndarray
            Curvature by the time of one camera, the points fixed.
        y : (3, C, P) ndarray
            The points eliminated, the curvature by two times is ``h_c`` on the diagonal less
            ``y_c . y_d``.
        g : (C, P) ndarray
            Gradient with the points eliminated.
        """
        m, q = self.weighted(scale)
        R_T = np.swapaxes(self.cameras.R, -1, -2)
        RV = self.RV if V is None else self.cameras.R @ V
        pull = self._pull(m, RV)
        factors = self._point_factors(m)
        y = forward_solve(factors, (R_T @ pull).transpose(1, 0, 2).copy())
        z = forward_solve(factors, (R_T @ q).sum(0))
        g = (q * RV).sum(1) - (y * z[:, None]).sum(0)
        return (pull * RV).sum(1), y, g

    def unweighted_factors(self) -> tuple[Float64Array, ...]:
        """Cholesky factors of the points' own normal equations, all keypoints of one weight."""
        return self._point_factors(self.weighted(np.inf)[0])

    def _point_factors(self, m: Float64Array) -> tuple[Float64Array, ...]:
        """Cholesky factors of the sums of ``R^T M R`` over the cameras."""
        R = self.cameras.R[..., None]
        rows = R[:, :2] - self.u[:, :, None] * R[:, 2:]
        C, P = m.shape
        A = (rows * np.sqrt(m)[:, None, None]).reshape(2 * C, 3, P)
        return cholesky3(np.einsum("njp,nkp->jkp", A, A), 0.0)

    def back_substitute(
        self, eliminated: BackSubstitution, scale: float, d_camera: Float64Array
    ) -> Float64Array:
        """Joints (P, 3) after a step (C, n) of the cameras and the step of the points to it."""
        m, _ = self.weighted(scale)
        omega, d_t, d_shift = (
            d_camera[:, self.layout.within(unknown)]
            for unknown in (ROTATION, TRANSLATION, TIME_OFFSET)
        )
        moved = hat(omega) @ self.Y + d_t[:, :, None] + d_shift[:, :, None] * self.RV
        for unknown in self.layout.further:
            step = d_camera[:, self.layout.within(unknown)]
            moved += step[:, :, None] * self._displacement(unknown)
        pull = self._pull(m, moved)
        towards = (np.swapaxes(self.cameras.R, -1, -2) @ pull).sum(0)
        y = eliminated.z + forward_solve(eliminated.factors, towards)
        return np.asarray((self.X - backward_solve(eliminated.factors, y)).T)

    def settled(self, scale: float) -> Float64Array:
        """Joints (P, 3) after a step of their own, the cameras fixed."""
        m, q = self.weighted(scale)
        factors = self._point_factors(m)
        z = forward_solve(factors, (np.swapaxes(self.cameras.R, -1, -2) @ q).sum(0))
        return np.asarray((self.X - backward_solve(factors, z)).T)

    def _displacement(self, unknown: CameraUnknown) -> Float64Array:
        """Displacements (C, 3, P) by an unknown beyond pose and time offset, per unit."""
        if unknown not in self._displacements:
            self._displacements[unknown] = np.asarray(unknown.derivative(self.view)[:, 0])
        return self._displacements[unknown]

    def _pull(self, m: Float64Array, moved: Float64Array) -> Float64Array:
        """``M`` times displacements (C, 3, P) in the axes of the cameras."""
        pull = np.empty_like(moved)
        pull[:, :2] = m[:, None] * (moved[:, :2] - self.u * moved[:, 2:])
        pull[:, 2] = -(self.u[:, 0] * pull[:, 0] + self.u[:, 1] * pull[:, 1])
        return pull

    def _camera_rows(self, m: Float64Array) -> Float64Array:
        """Rows j of M times the displacements by each unknown, (3, C, n, P).

        Those by pose and time offset, ``[-y x, I, R V]``, are written out for speed.
        """
        C, P = m.shape
        N = np.empty((3, C, self.layout.block, P))
        Y, RV, u = self.Y, self.RV, self.u
        mu = m[:, None] * u
        N[0, :, 3], N[0, :, 4], N[0, :, 5] = m, 0.0, -mu[:, 0]
        N[1, :, 3], N[1, :, 4], N[1, :, 5] = 0.0, m, -mu[:, 1]
        N[2, :, 3:5] = -mu
        N[2, :, 5] = mu[:, 0] * u[:, 0] + mu[:, 1] * u[:, 1]
        for j in range(3):
            a, b, c = N[j, :, 3], N[j, :, 4], N[j, :, 5]
            N[j, :, 0] = Y[:, 1] * c - Y[:, 2] * b
            N[j, :, 1] = Y[:, 2] * a - Y[:, 0] * c
            N[j, :, 2] = Y[:, 0] * b - Y[:, 1] * a
            N[j, :, 6] = a * RV[:, 0] + b * RV[:, 1] + c * RV[:, 2]
        for unknown in self.layout.further:
            own = self.layout.within(unknown)
            N[:, :, own.start] = self._pull(m, self._displacement(unknown)).swapaxes(0, 1)
        return N

    def _camera_block(self, N: Float64Array) -> Float64Array:
        """Sums (C, n, n) of ``J^T w J`` over the points.

        By moments of N with y and R V for pose and time offset.
        """
        C, P = self.squared.shape
        with_what = np.concatenate([self.Y, self.RV, np.ones((C, 1, P))], 1)
        Q = N @ with_what.transpose(0, 2, 1)
        H = np.empty((C, self.layout.block, self.layout.block))
        for b in range(3):
            i, k = (b + 1) % 3, (b + 2) % 3
            H[:, :, b] = Q[k, :, :, i] - Q[i, :, :, k]
            H[:, :, 3 + b] = Q[b, :, :, 6]
        H[:, :, 6] = Q[0, :, :, 3] + Q[1, :, :, 4] + Q[2, :, :, 5]
        for unknown in self.layout.further:
            own = self.layout.within(unknown)
            moved = self._displacement(unknown)
            H[:, :, own] = sum(N[j] @ moved[:, j, :, None] for j in range(3))
        return H

    def _point_block(self, W: Float64Array) -> Float64Array:
        """Sums (3, 3, P) of ``R^T M R`` over the cameras; W (3, C, n, P) holds ``R^T M``."""
        _, C, n, P = W.shape
        R = np.zeros((C, n, 3))
        R[:, self.layout.within(TRANSLATION)] = self.cameras.R
        return np.asarray(R.reshape(-1, 3).T @ W.reshape(3, C * n, P))

    def _gradients(self, q: Float64Array) -> Float64Array:
        """Camera gradients (C, n, P) of the single points."""
        out = np.empty((len(q), self.layout.block, q.shape[-1]))
        Y = self.Y
        for b in range(3):
            i, k = (b + 1) % 3, (b + 2) % 3
            out[:, b] = Y[:, i] * q[:, k] - Y[:, k] * q[:, i]
        out[:, self.layout.within(TRANSLATION)] = q
        out[:, self.layout.within(TIME_OFFSET).start] = (q * self.RV).sum(1)
        for unknown in self.layout.further:
            out[:, self.layout.within(unknown).start] = (q * self._displacement(unknown)).sum(1)
        return out


def cholesky3(H: Float64Array, damping: float) -> tuple[Float64Array, ...]:
    """Cholesky factors (l00, l10, l11, l20, l21, l22), each (P,), of matrices (3, 3, P)."""
    tiny = 1e-12 * (H[0, 0] + H[1, 1] + H[2, 2]) + 1e-30
    grow = 1.0 + damping
    l00 = np.sqrt(H[0, 0] * grow + tiny)
    l10, l20 = H[1, 0] / l00, H[2, 0] / l00
    l11 = np.sqrt(np.maximum(H[1, 1] * grow + tiny - l10**2, tiny))
    l21 = (H[2, 1] - l20 * l10) / l11
    l22 = np.sqrt(np.maximum(H[2, 2] * grow + tiny - l20**2 - l21**2, tiny))
    return l00, l10, l11, l20, l21, l22


def forward_solve(factors: tuple[Float64Array, ...], b: Float64Array) -> Float64Array:
    """``L y = b`` for b (3, ..., P), in place."""
    l00, l10, l11, l20, l21, l22 = factors
    b[0] /= l00
    b[1] -= l10 * b[0]
    b[1] /= l11
    b[2] -= l20 * b[0]
    b[2] -= l21 * b[1]
    b[2] /= l22
    return b


def backward_solve(factors: tuple[Float64Array, ...], y: Float64Array) -> Float64Array:
    """``L^T x = y`` for y (3, P)."""
    l00, l10, l11, l20, l21, l22 = factors
    x = np.empty_like(y)
    x[2] = y[2] / l22
    x[1] = (y[1] - l21 * x[2]) / l11
    x[0] = (y[0] - l10 * x[1] - l20 * x[2]) / l00
    return x
