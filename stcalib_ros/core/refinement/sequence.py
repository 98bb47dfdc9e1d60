"""The refinement of an adjusted rig: what else than poses and offsets is unknown, in one system."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.covariance import JointCovariance, information, publication
from stcalib_ros.core.bundle.iteration import Iteration, absorbed
from stcalib_ros.core.bundle.lens_unknowns import LENS_UNKNOWNS
from stcalib_ros.core.bundle.levenberg_marquardt import Motion
from stcalib_ros.core.bundle.parameters import ParameterLayout
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.options import BundleOptions
from stcalib_ros.core.refinement.clock_skew import clock_skews
from stcalib_ros.core.refinement.joint_adjustment import JointAdjustment, adjust_jointly
from stcalib_ros.core.refinement.keypoint_bias.stage import UnbiasedRound, refine_keypoint_bias
from stcalib_ros.core.refinement.line_delay import line_delays, middle_rows
from stcalib_ros.core.refinement.spline_trajectories import with_splines
from stcalib_ros.core.refinement.timestamp_jitter import added_covariance, with_timestamp_errors
from stcalib_ros.core.refinement.velocity_noise import compensated


@dataclass(frozen=True, slots=True, eq=False)
class Refinement:
    """The rounds of an adjustment, the last one refined.

    Attributes
    ----------
    iterations : tuple of Iteration
        Where keypoints are biased, the last but one is the round before their correction.
    covariance : JointCovariance
        Of the last one.
    """

    iterations: tuple[Iteration, ...]
    covariance: JointCovariance


def refine(
    cameras: Sequence[LiftedCamera],
    iterations: tuple[Iteration, ...],
    layout: Layout,
    options: BundleOptions,
    *,
    estimate_line_delays: bool = False,
) -> Refinement:
    """Refine the last round of an adjustment.

    1. Clock skews and line delays that are observable join poses and offsets.
    2. Keypoint biases, if there are any, are estimated with all of these, and the keypoints
       corrected. Before the timestamps: jitter would explain a part of the biases.
    3. Timestamps that jitter are corrected image by image.
    4. Everything of 1. once more with corrected keypoints and timestamps.
    5. Offsets are compensated for noise in the velocities; where depths are hardly known, the
       velocities along them are smoothed.
    6. Irregularly sampled images: joints become smooth trajectories, whose velocities need no 5.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras of the recording.
    iterations : tuple of Iteration
        The last one at its optimum.
    layout : Layout
        Of the keypoints.
    options : BundleOptions
    estimate_line_delays : bool
        Line delays are unknowns where they are observable; else they are as given.
    """
    members = [cameras[c] for c in iterations[-1].rig.cameras]
    joint = adjust_jointly(
        members, iterations[-1], options, estimate_line_delays=estimate_line_delays
    )
    iterations = (*iterations[:-1], joint.iteration)
    unbiased = refine_keypoint_bias(cameras, joint.iteration, layout, options, joint.layout)
    if unbiased is not None:
        iterations = (*iterations, replace(unbiased.round, uncorrected=joint.iteration))
    last = with_timestamp_errors(cameras, iterations[-1], options, joint.layout)
    if last is not joint.iteration:
        joint = adjust_jointly(members, last, options, estimate_line_delays=estimate_line_delays)
    last, motion = compensated(joint.iteration, joint.layout, options)
    last = with_splines(cameras, last, options)
    covariance = _covariance(members, last, joint, unbiased, layout, motion)
    last = _with_records(members, last, joint, covariance.matrix)
    return Refinement((*iterations[:-1], last), covariance)


def _covariance(
    members: Sequence[LiftedCamera],
    last: Iteration,
    joint: JointAdjustment,
    unbiased: UnbiasedRound | None,
    layout: Layout,
    motion: Motion,
) -> JointCovariance:
    """Covariance of everything that was estimated."""
    unknowns = joint.layout
    known = information(last.observations, last.state, unknowns, motion=motion)
    P = known.covariance(unknowns)
    P = P + added_covariance(last.timestamp_errors, unknowns)
    eliminated = {}
    if unbiased is not None:
        P = P + unbiased.added_covariance(unknowns)
        eliminated = unbiased.unknowns(layout.joint_names, unknowns)
    published = publication(last.state.cameras, unknowns, middle_rows(members))
    names = tuple(member.name for member in members)
    return JointCovariance(names, unknowns, P, published, eliminated)


def _with_records(
    members: Sequence[LiftedCamera], last: Iteration, joint: JointAdjustment, P: Float64Array
) -> Iteration:
    """The round with its skews, line delays and lenses, and how well they are known."""
    skews, delays = joint.skews, joint.delays
    return replace(
        absorbed(last),
        lens_stddev=_lens_stddev(joint.layout, P) if last.state.lenses is not None else None,
        clock_skews=None if skews is None else clock_skews(last, skews, joint.layout, P),
        line_delays=None if delays is None else line_delays(members, last, delays, joint.layout, P),
    )


def _lens_stddev(layout: ParameterLayout, P: Float64Array) -> Float64Array:
    """Standard deviations (5, C) of the corrections of the lenses."""
    variance = np.diag(P)
    rows = [
        variance[layout.scalars(one)] if one in layout.further else np.zeros(layout.n_cameras)
        for one in LENS_UNKNOWNS
    ]
    return np.asarray(np.sqrt(np.maximum(rows, 0.0)))
