"""Motion of joints whose depth is hardly known.

Cameras side by side know where a joint is across their views ten times as well as along them, and
the local fit reads velocities from such positions that are mostly noise along the views. An image
half a frame after its time bin observes a joint at ``X + phi V``: with that noise it is seen at
another depth than by the other cameras, and what depends on products of such depths does not
average out. Cameras 30 cm apart turn by fifteen standard deviations.

Between the local fit and a smooth one, a Wiener filter keeps of the difference what is motion,
along each principal direction of the covariance of a joint. Along the one that is known best the
local fit stays as it is: there it is compared with the images.

References
----------
N. Wiener, "Extrapolation, interpolation and smoothing of stationary time series", 1949.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.bundle.levenberg_marquardt import PointProblem
from stcalib_ros.core.bundle.limits import MAX_POINT_VARIANCE
from stcalib_ros.core.bundle.normal_equations import forward_solve
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.residuals import noise_px
from stcalib_ros.core.bundle.state import BundleState, estimate_motion, motion_half_window
from stcalib_ros.core.geometry.local_polynomial import removed_energy
from stcalib_ros.core.geometry.robust import CAUCHY
from stcalib_ros.core.model.arrays import BoolArray, Float64Array

_SMOOTHING_S = 0.25
"""Seconds. Half window of the smooth fit: half a step of a person who walks. Chosen."""

_SAMPLE = 1_000
"""Count. Joints by which is decided whether depths are known badly, about. Numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class MotionFilter:
    """Reads velocities and accelerations from joints, smooth where these are uncertain.

    Attributes
    ----------
    gains : (2, N, J, 3, 3) ndarray
        What is kept of the difference of the local fit from a smooth one: velocity, acceleration.
    present : (N, J) ndarray of bool
        Joints that are determined well enough to read motion from.
    """

    gains: Float64Array
    present: BoolArray

    def __call__(
        self, obs: Observations, X: Float64Array, present: BoolArray
    ) -> tuple[Float64Array, Float64Array]:
        """Velocities and accelerations (N, J, 3), linear in X; as `estimate_motion`."""
        present = present & self.present
        fine = estimate_motion(obs, X, present)
        smooth = estimate_motion(obs, X, present, smooth_s=_SMOOTHING_S)
        V, A = (
            base + (gain @ (local - base)[..., None])[..., 0]
            for gain, local, base in zip(self.gains, fine, smooth, strict=True)
        )
        return V, A


def motion_filter(obs: Observations, state: BundleState) -> MotionFilter:
    """The filter that suits the joints of a state.

    Parameters
    ----------
    obs : Observations
    state : BundleState
    """
    variance, axes = principal_variances(obs, state, noise_px(obs, state))
    known = np.isfinite(variance[..., 0])
    total = variance.sum(-1)
    present = known & (total < MAX_POINT_VARIANCE * np.median(total[known]))
    fine = estimate_motion(obs, state.X, present)
    smooth = estimate_motion(obs, state.X, present, smooth_s=_SMOOTHING_S)
    half_windows = motion_half_window(obs), motion_half_window(obs, _SMOOTHING_S)
    gains = np.empty((2, *axes.shape))
    for n, energy in enumerate(removed_energy(*half_windows)):
        noise = energy / obs.step_s ** (2 * n + 2) * np.where(known[..., None], variance, 0.0)
        best = ((fine[n] - smooth[n]) * axes[..., 0]).sum(-1) ** 2 - noise[..., 0]
        motion = np.maximum(_mean(best, present), 0.0)[:, None]
        gain = (motion + noise[..., :1] + 1e-30) / (motion + noise + 1e-30)
        gains[n] = (axes * gain[..., None, :]) @ np.swapaxes(axes, -1, -2)
    return MotionFilter(gains, present)


def _mean(values: Float64Array, chosen: BoolArray) -> Float64Array:
    """Means (J,) of chosen ones of values (N, J); 0 without any."""
    total = np.where(chosen, values, 0.0).sum(0)
    return np.asarray(total / np.maximum(chosen.sum(0), 1))


def principal_variances(
    obs: Observations, state: BundleState, sigma_px: float
) -> tuple[Float64Array, Float64Array]:
    """Variances (N, J, 3) of joints along their principal axes (N, J, 3, 3), increasing.

    The cameras count as known, and all keypoints as equally good; NaN where fewer than two cameras
    observe a joint. Axes are columns.
    """
    covariance = np.full((state.X.shape[0] * state.X.shape[1], 3, 3), np.nan)
    for block, at in PointProblem(obs, state, CAUCHY * sigma_px).linearised():
        unit = np.eye(3)[:, :, None] * np.ones(len(block.points))
        half = forward_solve(at.unweighted_factors(), unit)
        covariance[block.points] = np.einsum("jkp,jlp->pkl", half, half)
    known = np.isfinite(covariance[:, 0, 0])
    value, axes = np.linalg.eigh(np.where(known[:, None, None], covariance, np.eye(3)))
    value = np.where(known[:, None], sigma_px**2 * np.maximum(value, 0.0), np.nan)
    return value.reshape(state.X.shape), axes.reshape(*state.X.shape, 3)


def depth_variance_ratio(obs: Observations, state: BundleState) -> float:
    """Median ratio of the largest to the least variance of a joint; NaN without joints."""
    rows = slice(None, None, max(1, state.X.shape[0] * state.X.shape[1] // _SAMPLE))
    chosen = np.arange(len(state.X))[rows]
    variance, _ = principal_variances(obs.only(chosen), state.only(chosen), 1.0)
    known = variance[np.isfinite(variance[..., 0])]
    return float(np.median(known[:, 2] / known[:, 0])) if len(known) else float("nan")
