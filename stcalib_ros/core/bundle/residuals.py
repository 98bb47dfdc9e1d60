"""Reprojection residuals, their derivatives and their scale."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from stcalib_ros.core.bundle.limits import NEAREST
from stcalib_ros.core.bundle.observations import Observations, blocks_of
from stcalib_ros.core.bundle.parameters import Cameras, ParameterLayout
from stcalib_ros.core.bundle.point_views import PointTimes, PointView
from stcalib_ros.core.bundle.state import BundleState, triangulated
from stcalib_ros.core.geometry.robust import LEAST_SHARE, MIN_SCALE_PX, RAYLEIGH_MEDIAN
from stcalib_ros.core.model.arrays import BoolArray, Float32Array, Float64Array, IntArray

_FAR = 1e3
"""Cauchy scales. Residual of a keypoint whose point is behind its camera. Numerical."""


class Projection:
    """Predicted keypoints, their residuals and derivatives, with Cauchy weights.

    Arrays are over (..., camera, component, point), points contiguous. The residual of a keypoint
    moves with a displacement of its point in the axes of the camera by a 2x3 matrix A, row 0
    ``(f/z) (1, 0, -u)``, row 1 ``(f/z) (0, 1, -v)``.

    Parameters
    ----------
    cameras : Cameras
    y, velocity : (..., C, 3, P) ndarray
        Points at the times of their keypoints, and their velocities, in the axes of the cameras.
    times : PointTimes
    x : (..., C, 2, P) ndarray
        Keypoints on the plane z = 1.
    focal : (..., C, P) ndarray
        Pixels per unit of x; 0 where a keypoint takes no part.
    """

    def __init__(
        self,
        cameras: Cameras,
        y: Float64Array,
        velocity: Float64Array,
        times: PointTimes,
        x: Float64Array,
        focal: Float64Array,
    ) -> None:
        self.cameras, self.Y, self.RV, self.times, self.focal = cameras, y, velocity, times, focal
        Z = y + cameras.t[:, :, None]
        self.Z = (
            Z
            if not cameras.further
            else cameras.displaced(PointView(y, velocity, Z, times, cameras.lenses))
        )
        depth = self.Z[..., 2, :]
        self.ahead = depth > NEAREST
        self.inverse_depth = 1.0 / np.where(self.ahead, depth, 1.0)
        self.u = self.Z[..., :2, :] * self.inverse_depth[..., None, :]
        self.r = (self.u - x) * focal[..., None, :]
        self.squared = self.r[..., 0, :] ** 2 + self.r[..., 1, :] ** 2

    @cached_property
    def view(self) -> PointView:
        """What the derivatives depend on."""
        return PointView(self.Y, self.RV, self.Z, self.times, self.cameras.lenses)

    def squared_px(self, scale: float) -> Float64Array:
        """Squared residuals (..., C, P); of points behind their camera as of far outliers."""
        far = (_FAR * scale) ** 2 * (self.focal > 0.0)
        return np.asarray(np.where(self.ahead, self.squared, far))

    def cost(self, scale: float) -> float:
        """Robust cost."""
        return float(np.log1p(self.squared_px(scale) / scale**2).sum())

    def weight(self, scale: float) -> Float64Array:
        """Cauchy weights (..., C, P); 0 behind the camera."""
        return self.ahead / (1.0 + self.squared / scale**2)

    def weighted(self, scale: float) -> tuple[Float64Array, Float64Array]:
        """The factor m (C, P) of ``M = A^T w A``, and ``A^T w r`` (C, 3, P)."""
        gain = self.focal * self.inverse_depth
        pull = gain * self.weight(scale)
        q = np.empty_like(self.Y)
        np.multiply(self.r, pull[..., None, :], out=q[..., :2, :])
        q[..., 2, :] = -(self.u[..., 0, :] * q[..., 0, :] + self.u[..., 1, :] * q[..., 1, :])
        return gain * pull, q

    def rows(self, scale: float) -> tuple[Float64Array, Float64Array]:
        """``sqrt(w) A`` (..., C, 2, 3, P) and ``sqrt(w) r`` (..., C, 2, P)."""
        root = np.sqrt(self.weight(scale))
        gain = self.focal * self.inverse_depth * root
        A = np.zeros((*gain.shape[:-1], 2, 3, gain.shape[-1]))
        for i in range(2):
            A[..., i, i, :] = gain
            A[..., i, 2, :] = -gain * self.u[..., i, :]
        return A, self.r * root[..., None, :]

    def camera_columns(self, A: Float64Array, layout: ParameterLayout) -> Float64Array:
        """Derivatives (..., C, block, 2, P) by the unknowns of the cameras, of rows A."""
        columns = np.empty((*A.shape[:-3], layout.block, 2, A.shape[-1]))
        for unknown in layout.unknowns:
            moved = unknown.derivative(self.view)
            columns[..., layout.within(unknown), :, :] = sum(
                A[..., None, :, k, :] * moved[..., :, None, k, :] for k in range(3)
            )
        return columns

    def point_columns(self, A: Float64Array) -> Float64Array:
        """Derivatives (..., C, 2, 3, P) by the points in the reference frame, of rows A."""
        R = self.cameras.R[:, None, :, :, None]
        return np.asarray(sum(A[..., k, None, :] * R[..., k, :, :] for k in range(3)))


def at_images(
    obs: Observations, state: BundleState, rows: slice | IntArray = slice(None)
) -> Float64Array:
    """Joints (N, C, J, 3) in the reference frame at the time of each camera's image."""
    when = (obs.elapsed(rows) + state.cameras.delay(obs.point_times(rows)))[..., None]
    V, A = state.V[rows][:, None], state.A[rows][:, None]
    return np.asarray(state.X[rows][:, None] + when * (V + 0.5 * when * A))


def camera_points(
    obs: Observations, state: BundleState, rows: slice | IntArray = slice(None)
) -> Float64Array:
    """Joints (N, C, J, 3) in the frames of the cameras at the time of each camera's image."""
    y = at_images(obs, state, rows) @ np.swapaxes(state.R_cam_ref, -1, -2)
    Z = y + state.t_cam_ref[:, None]
    if not any(unknown.displacements for unknown in state.further):
        return Z
    y, Z = y.swapaxes(-1, -2), Z.swapaxes(-1, -2)
    view = PointView(y, np.zeros_like(y), Z, obs.point_times(rows), state.lenses)
    moved = state.cameras.displaced(view)
    return np.asarray(moved.swapaxes(-1, -2))


def residuals_px(
    obs: Observations, state: BundleState, rows: slice = slice(None)
) -> tuple[Float64Array, BoolArray]:
    """Reprojection residuals (N, C, J, 2), px, and which of them take part and are finite."""
    Y = camera_points(obs, state, rows)
    with np.errstate(divide="ignore", invalid="ignore"):
        r = (Y[..., :2] / Y[..., 2:] - obs.x[rows]) * obs.focal[rows][..., None]
    r[Y[..., 2] < NEAREST] = np.inf
    return r, state.inlier[rows] & np.isfinite(r).all(-1)


def errors_px(obs: Observations, state: BundleState) -> Float32Array:
    """Reprojection errors (N, C, J), px; NaN where nothing was seen or no point is known.

    As precise as the image points are.
    """
    out, determined = np.empty(obs.observed.shape, obs.x.dtype), state.triangulated()
    for rows in blocks_of(obs):
        r = residuals_px(obs, state, rows)[0]
        known = obs.observed[rows] & determined[rows][:, None]
        out[rows] = np.where(known, np.sqrt(r[..., 0] ** 2 + r[..., 1] ** 2), np.nan)
    return out


def median_error(errors: Float32Array, used: BoolArray) -> float:
    """Median of the used and finite errors (N, C, J), px; NaN if there is none."""
    chosen = errors[used & np.isfinite(errors)]
    return float(np.median(chosen, overwrite_input=True)) if len(chosen) else float("nan")


def robust_scale(errors: Float32Array, used: BoolArray) -> float:
    """Standard deviation (px, per axis) of the inliers (N, C, J), from their median.

    Every point takes three of the coordinates of its observations: what the residuals keep of
    the noise is smaller by that fraction.
    """
    known = used & np.isfinite(errors)
    if not known.any():
        return float("nan")
    fraction = 1.0 - 1.5 * float(triangulated(known).sum()) / float(known.sum())
    sigma = median_error(errors, used) / RAYLEIGH_MEDIAN
    return sigma / float(np.sqrt(max(fraction, LEAST_SHARE)))


def noise_px(obs: Observations, state: BundleState) -> float:
    """Standard deviation of the keypoints, px per axis, from the residuals of a state."""
    return max(robust_scale(errors_px(obs, state), state.inlier), MIN_SCALE_PX)
