"""The projection matrix of a camera from points of space: a resection without a start.

References
----------
R. Hartley, A. Zisserman, "Multiple View Geometry in Computer Vision", 2nd ed., 2003: the linear
solution (section 7.1) and its decomposition (6.2.4).
"""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array

_PASSES = 12
"""Count. Solutions with weights by the errors of the one before. Numerical: ten are enough."""
_OUTLIER_RATIO = 2.0
"""Ratio to the median error. Scale of the Cauchy weight: outliers are few. Chosen."""
_SPREAD = 1.5
"""Ratio to the median deviation. Unit of points and keypoints in the linear system. Numerical."""
_DEPTHS = (0.1, 10.0)
"""Ratios to the median depth within which depths weigh the linear equations. Numerical."""
_TINY = 1e-12
"""Units of the linear system. Keeps exact keypoints from dividing by zero. Numerical."""


def linear_projection(X: Float64Array, x: Float64Array) -> Float64Array:
    """Return the matrix P (3, 4) with ``x = P X``, robustly.

    Parameters
    ----------
    X : (N, 3) ndarray
        Points of space; six and more, not in one plane.
    x : (N, 2) ndarray
        Their images.
    """
    to_space, Y = _normalised(X)
    to_image, y = _normalised(x)
    zero, one = np.zeros_like(Y), np.ones((len(Y), 1))
    Y, zero = np.concatenate([Y, one], 1), np.concatenate([zero, 0 * one], 1)
    rows = np.stack(
        [
            np.concatenate([Y, zero, -y[:, :1] * Y], 1),
            np.concatenate([zero, Y, -y[:, 1:] * Y], 1),
        ],
        1,
    )
    weight: Float64Array = np.ones(len(Y))
    for _ in range(_PASSES):
        A = rows * np.sqrt(weight)[:, None, None]
        A = A.reshape(-1, A.shape[-1])
        P = np.linalg.eigh(A.T @ A)[1][:, 0].reshape(3, 4)
        image = Y @ P.T
        depth = image[:, 2] / np.median(image[:, 2])
        depth = np.clip(np.abs(depth), *_DEPTHS)
        with np.errstate(divide="ignore", invalid="ignore"):
            error = np.nan_to_num(np.linalg.norm(image[:, :2] / image[:, 2:] - y, axis=1))
        scale = _OUTLIER_RATIO * float(np.median(error)) + _TINY
        weight = 1.0 / (1.0 + (error / scale) ** 2) / depth**2
    P = np.linalg.inv(to_image) @ P @ to_space
    in_front = np.median(X @ P[2, :3] + P[2, 3]) > 0
    return np.asarray(P if in_front else -P)


def decomposed_projection(
    P: Float64Array,
) -> tuple[Float64Array, Float64Array, Float64Array] | None:
    """Return K, R and t of a projection matrix ``K [R t]``; None of a mirrored one.

    Parameters
    ----------
    P : (3, 4) ndarray
        Positive in front of the camera.
    """
    flip = np.eye(3)[::-1]
    Q, upper = np.linalg.qr((flip @ P[:, :3]).T)
    K, R = flip @ upper.T @ flip, flip @ Q.T
    sign = np.sign(np.diag(K))
    K, R = K * sign, sign[:, None] * R
    if not np.diag(K).all() or np.linalg.det(R) < 0:
        return None
    return K / K[2, 2], R, np.linalg.solve(K, P[:, 3])


def _normalised(points: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return a similarity (homogeneous matrix) that centres and scales points, and these."""
    middle = np.median(points, 0)
    spread = _SPREAD * float(np.median(np.abs(points - middle))) + _TINY
    T = np.eye(points.shape[1] + 1) / spread
    T[-1, -1] = 1.0
    T[:-1, -1] = -middle / spread
    return T, (points - middle) / spread
