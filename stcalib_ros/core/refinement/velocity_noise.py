"""The adjustment without what noise of the velocities does to it."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.levenberg_marquardt import Motion, adjust
from stcalib_ros.core.bundle.limits import FINAL_TOLERANCE, MAX_POINT_VARIANCE
from stcalib_ros.core.bundle.motion_filter import (
    depth_variance_ratio,
    motion_filter,
    principal_variances,
)
from stcalib_ros.core.bundle.offset_debiasing import debias_offsets, debiased
from stcalib_ros.core.bundle.outliers import drop_outliers, implausible_joints
from stcalib_ros.core.bundle.parameters import ParameterLayout
from stcalib_ros.core.bundle.pose_debiasing import debiased_poses
from stcalib_ros.core.bundle.residuals import noise_px
from stcalib_ros.core.bundle.state import BundleState, estimate_motion
from stcalib_ros.core.options import BundleOptions
from stcalib_ros.core.refinement.limits import MAX_DEPTH_VARIANCE_RATIO

_PASSES = 3
"""Count. Adjustments with the filter anew. Numerical: gains hardly change after the second."""


def compensated(
    last: Iteration, layout: ParameterLayout, options: BundleOptions
) -> tuple[Iteration, Motion]:
    """Compensate a round for noise in its velocities, and say how these are read.

    That of all directions biases the offsets; that of depths which are hardly known, the poses.

    Parameters
    ----------
    last : Iteration
        At its optimum.
    layout : ParameterLayout
        Its unknowns.
    options : BundleOptions
    """
    obs, state = last.observations, last.state
    if depth_variance_ratio(obs, state) > MAX_DEPTH_VARIANCE_RATIO:
        state, motion = _with_smooth_depths(last, layout, options)
        return last.with_state(obs, debiased_poses(obs, state, layout, motion)), motion
    compensated = debias_offsets(obs, state, iterations=options.max_iterations)
    if compensated is state:
        compensated = debiased(obs, state)
    return last.with_state(obs, compensated), estimate_motion


def _with_smooth_depths(
    last: Iteration, layout: ParameterLayout, options: BundleOptions
) -> tuple[BundleState, Motion]:
    """Adjust with velocities that are smooth along the depths.

    Implausible joints take no part, nor do those nearly in line with the cameras that observe them:
    noise moves these by more than projections are linear in.
    """
    obs, state = last.observations, last.state
    motion: Motion = estimate_motion
    for n in range(_PASSES):
        if n:
            state = drop_outliers(obs, state, options)
        variance, _ = principal_variances(obs, state, noise_px(obs, state))
        wrong = implausible_joints(obs, state, variance[..., 2])
        wrong |= variance[..., 2] > MAX_POINT_VARIANCE * np.nanmedian(variance[..., 2])
        state = state.with_inliers(state.inlier & ~wrong[:, None])
        motion = motion_filter(obs, state)
        state = adjust(
            obs,
            state,
            iterations=options.max_iterations,
            tolerance=FINAL_TOLERANCE,
            renew_velocities=True,
            layout=layout,
            motion=motion,
            settle_points=True,
        )
    return state, motion
