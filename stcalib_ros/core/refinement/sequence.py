"""Refinement: the optional unknowns, in the order in which they are estimated."""

from __future__ import annotations

from collections.abc import Sequence

from stcalib_ros.core.bundle.covariance import pose_covariance
from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.offset_debiasing import debias_offsets, debiased
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.options import BundleOptions
from stcalib_ros.core.refinement.clock_skew import with_clock_skews
from stcalib_ros.core.refinement.keypoint_bias.stage import refine_keypoint_bias
from stcalib_ros.core.refinement.line_delay import (
    refine_with_line_delays,
    with_line_delays,
)
from stcalib_ros.core.refinement.spline_trajectories import with_splines
from stcalib_ros.core.refinement.timestamp_jitter import (
    added_covariance,
    with_timestamp_errors,
)


def refine(
    cameras: Sequence[LiftedCamera],
    iterations: tuple[Iteration, ...],
    layout: Layout,
    options: BundleOptions,
    *,
    estimate_line_delay: bool,
) -> tuple[tuple[Iteration, ...], Float64Array]:
    """Adjust with line delays, keypoint biases, timestamp errors, clock skews and splines.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras of the recording.
    iterations : tuple of Iteration
        Those of the adjustment.
    layout : Layout
        Joints of the people.
    options : BundleOptions
    estimate_line_delay : bool
        Estimate the line delays of rolling shutters.

    Returns
    -------
    tuple of Iteration
        The same with the last one refined, and one more before it where keypoints are biased.
    (7 C, 7 C) ndarray
        Covariance of all cameras.
    """
    last = iterations[-1]
    if estimate_line_delay:
        last, biased = refine_with_line_delays(cameras, last, layout, options)
        iterations = (*iterations[:-1], last)
    else:
        biased = refine_keypoint_bias(cameras, last, layout, options)
    if biased is not None:
        last = biased.round
        iterations += (last,)
    last = with_timestamp_errors(cameras, last, options)
    if estimate_line_delay and last.stamps is not None:
        last = with_line_delays(cameras, last, options)
    last = with_clock_skews(last, options)
    state = debias_offsets(last.observations, last.state, iterations=options.max_iterations)
    if state is last.state:
        state = debiased(last.observations, state)
    last = with_splines(cameras, last.moved(last.observations, state), options)
    covariance = pose_covariance(last.observations, last.state) + added_covariance(last)
    if last.lines is not None:
        covariance = covariance + last.lines.added
    if biased is not None:
        covariance = covariance + biased.excess
    return (*iterations[:-1], last), covariance
