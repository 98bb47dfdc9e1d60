"""Normal equations of cameras and keypoint biases, the joint positions eliminated.

The bias of one joint of one person touches only the keypoints of that joint: after the positions
it is eliminated, joint by joint, which leaves a small dense system of the cameras. Arrays are over
(..., joint, row), rows last; joints and rows of a part are the points of a `Projection`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.bundle.normal_equations import backward_solve, cholesky3, forward_solve
from stcalib_ros.core.bundle.parameters import Cameras, ParameterLayout
from stcalib_ros.core.bundle.point_views import PointTimes
from stcalib_ros.core.bundle.residuals import Projection
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray

_COLUMNS = 32
"""Count. Columns of the products of one joint. Numerical: BLAS spreads larger ones over threads,
which takes several times the CPU time for matrices of this size."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Keypoints of one person in some rows.

    Attributes
    ----------
    person : int
        Position among the biases.
    rows : slice
        Of the observations.
    x : (C, 2, J, n) ndarray
    focal : (C, J, n) ndarray
        0 where a keypoint does not take part.
    phi : (C, J, n) or (C, 1, n) ndarray
        Time of the keypoint after the time bin, s.
    since_s : (n,) ndarray
        Time of the rows after the middle of the recording, s.
    row : (C, J, n) ndarray or None
        Rows of the keypoints in their images.
    V, A : (3, J, n) ndarray
        Velocities and accelerations.
    R_ref_body : (3, 3, n) ndarray
    basis : (C, B, n) ndarray
        Harmonics of the direction to the cameras.
    axes : (C, 3, 2) ndarray
        Axes of the images, to the right and down, reference frame.
    """

    person: int
    rows: slice
    x: Float64Array
    focal: Float64Array
    phi: Float64Array
    since_s: Float64Array
    row: Float64Array | None
    V: Float64Array
    A: Float64Array
    R_ref_body: Float64Array
    basis: Float64Array
    axes: Float64Array

    @property
    def in_body(self) -> int:
        """Number 3 B of the coefficients of the harmonics of a joint."""
        return int(3 * self.basis.shape[1])

    @property
    def size(self) -> int:
        """Number q of coefficients of a joint: harmonics, images of all cameras, of each camera."""
        return self.in_body + 2 + 2 * len(self.axes)

    def own(self, camera: int) -> IntArray:
        """Positions of the coefficients that act in one camera."""
        first = self.in_body + 2 + 2 * camera
        return np.asarray(np.r_[: self.in_body + 2, first : first + 2])

    def displacement(self, camera: int, bias: Float64Array) -> Float64Array:
        """Displacements (3, J, n), reference frame, of keypoints with coefficients (J, q)."""
        J, own = len(bias), bias[:, self.own(camera)]
        in_body = own[:, : self.in_body].reshape(J, 3, -1) @ self.basis[camera]
        in_image = self.axes[camera] @ own[:, self.in_body :].reshape(J, 2, 2).sum(1).T
        R = self.R_ref_body[:, :, None]
        return np.asarray(sum(R[:, b] * in_body[:, b] for b in range(3)) + in_image[:, :, None])

    def point_times(self, camera: int) -> PointTimes:
        """What the delays of the keypoints of one camera depend on, over (1, J n)."""
        since = np.broadcast_to(self.since_s, self.focal.shape[1:]).reshape(1, -1)
        row = np.zeros((1, 1)) if self.row is None else self.row[camera].reshape(1, -1)
        return PointTimes(since, row)

    def triangulated(self) -> BoolArray:
        """Joints (J, n) that two cameras or more determine."""
        return np.asarray((self.focal > 0.0).sum(0) >= 2)


def project(
    part: Part, c: int, cameras: Cameras, X: Float64Array, bias: Float64Array
) -> Projection:
    """Project joints X (3, J, n) with biases (J, q) into one camera; points are (J n)."""
    own, times = cameras.only(c), part.point_times(c)
    (J, n), R = X.shape[1:], cameras.R[c]
    delay = own.delay(times)
    when = part.phi[c] + (delay if delay.shape[-1] == 1 else delay.reshape(J, n))
    place = X + when * (part.V + 0.5 * when * part.A) + part.displacement(c, bias)
    y = (R @ place.reshape(3, J * n))[None]
    velocity = (R @ (part.V + when * part.A).reshape(3, J * n))[None]
    x = part.x[c].reshape(1, 2, J * n)
    return Projection(own, y, velocity, times, x, part.focal[c].reshape(1, J * n))


def follow(
    part: Part, cameras: Cameras, X: Float64Array, bias: Float64Array, scale: float, steps: int
) -> Float64Array:
    """Joints (3, J, n) after Gauss-Newton steps of their own, cameras and biases given."""
    for _ in range(steps):
        H, g = np.zeros((3, 3, *X.shape[1:])), np.zeros(X.shape)
        for c in range(len(cameras.t)):
            _, A, r = _by_joint(project(part, c, cameras, X, bias), scale, X.shape[1:])
            H += _squared(A)
            g += (A * r[:, None]).sum(0)
        factors = cholesky3(H, 0.0)
        X = X - backward_solve(factors, forward_solve(factors, g)) * part.triangulated()
    return X


def person_sums(
    part: Part,
    cameras: Cameras,
    X: Float64Array,
    bias: Float64Array,
    scale: float,
    layout: ParameterLayout,
) -> Float64Array:
    """Normal equations (J, m, m) of the camera unknowns, the biases and the right side.

    The joint positions X (3, J, n) are eliminated.
    """
    C, (J, n) = len(cameras.t), X.shape[1:]
    k, block = layout.size, layout.block
    m = k + part.size + 1
    H, W = np.zeros((3, 3, J, n)), np.zeros((3, m, J, n))
    S = np.zeros((J, m, m))
    for c in range(C):
        at = project(part, c, cameras, X, bias)
        rows, A, r = _by_joint(at, scale, (J, n))
        own = np.r_[layout.of_camera(c), k + part.own(c), m - 1]
        F = np.empty((J, len(own), 2, n))
        by_camera = at.camera_columns(rows, layout).reshape(block, 2, J, n)
        F[:, :block] = by_camera.transpose(2, 0, 1, 3)
        F[:, block:-1] = _bias_columns(part, c, A)
        F[:, -1] = r.swapaxes(0, 1)
        S[:, own[:, None], own] += _outer(F.reshape(J, len(own), 2 * n))
        H += _squared(A)
        f = F.transpose(2, 1, 0, 3)
        for a in range(3):
            W[a, own] += f[0] * A[0, a] + f[1] * A[1, a]
    W = forward_solve(cholesky3(H, 0.0), W)
    return np.asarray(S - _outer(W.transpose(2, 1, 0, 3).reshape(J, m, 3 * n)))


def _by_joint(
    at: Projection, scale: float, shape: tuple[int, ...]
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Weighted derivatives by displacements in the axes of the camera, and by the joints.

    (1, 2, 3, J n), (2, 3, J, n) and the weighted residuals (2, J, n).
    """
    rows, r = at.rows(scale)
    by_joint = at.point_columns(rows)
    return rows, by_joint.reshape(2, 3, *shape), r.reshape(2, *shape)


def _bias_columns(part: Part, c: int, A: Float64Array) -> Float64Array:
    """Weighted derivatives (J, 3 B + 4, 2, n) by the biases that act in one camera."""
    J, n = A.shape[2:]
    k = part.in_body
    out = np.empty((J, k + 4, 2, n))
    for i in range(2):
        in_body = sum(A[i, b][:, None] * part.R_ref_body[b] for b in range(3))
        out[:, :k, i] = (in_body[:, :, None] * part.basis[c]).reshape(J, -1, n)
        out[:, k : k + 2, i] = np.tensordot(A[i], part.axes[c], (0, 0)).transpose(0, 2, 1)
    out[:, k + 2 :] = out[:, k : k + 2]
    return out


def _outer(F: Float64Array) -> Float64Array:
    """``F F^T`` (J, q, q) of F (J, q, K), by a few of its K columns at a time."""
    blocks = (F[:, :, i : i + _COLUMNS] for i in range(0, F.shape[2], _COLUMNS))
    return np.asarray(sum(f @ f.swapaxes(1, 2) for f in blocks))


def _squared(A: Float64Array) -> Float64Array:
    """``A^T A`` (3, 3, J, n) of A (2, 3, J, n)."""
    return np.asarray(sum(a[:, None] * a[None] for a in A))
