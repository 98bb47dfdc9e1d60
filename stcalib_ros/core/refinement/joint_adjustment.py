"""One adjustment of poses, time offsets, clock skews and line delays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.covariance import Information, information
from stcalib_ros.core.bundle.istba import readjusted
from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.parameters import (
    CLOCK_SKEW,
    LINE_DELAY,
    CameraUnknown,
    ParameterLayout,
)
from stcalib_ros.core.bundle.residuals import noise_px
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.options import BundleOptions
from stcalib_ros.core.refinement.clock_skew import SkewSelection, select_skews
from stcalib_ros.core.refinement.limits import CONVERGED
from stcalib_ros.core.refinement.line_delay import DelaySelection, select_line_delays

_PASSES = 8
"""Count. Adjustments with velocities read anew at most. Numerical: usually two."""


@dataclass(frozen=True, slots=True, eq=False)
class JointAdjustment:
    """An adjusted round, and what was estimated in it.

    Attributes
    ----------
    iteration : Iteration
    layout : ParameterLayout
        Its unknowns.
    skews : SkewSelection or None
        None where the clocks are synchronised.
    delays : DelaySelection or None
        None where line delays were not asked for.
    """

    iteration: Iteration
    layout: ParameterLayout
    skews: SkewSelection | None = None
    delays: DelaySelection | None = None


def adjust_jointly(
    members: Sequence[LiftedCamera],
    last: Iteration,
    options: BundleOptions,
    *,
    estimate_line_delays: bool,
) -> JointAdjustment:
    """Adjust a round to all further unknowns of its cameras that are observable, in one system.

    The iteration is the same where there are none.

    Parameters
    ----------
    members : sequence of LiftedCamera
        The cameras of the round.
    last : Iteration
    options : BundleOptions
    estimate_line_delays : bool
        Line delays are asked for.
    """
    found, stddev = _selected(members, last, estimate_line_delays=estimate_line_delays)
    for n in range(_PASSES):
        before = found.iteration
        held = _held(before, found.layout)
        if set(found.layout.further) <= set(before.state.layout.further) and held is before:
            break
        after = readjusted(held, held.observations, options, last=True, layout=found.layout)
        found = replace(found, iteration=after)
        if n == 0:
            # What is observable shows better now that residuals are smaller.
            found, stddev = _selected(members, after, estimate_line_delays=estimate_line_delays)
        moved = [
            (np.abs(_moved(before, after, one)) > CONVERGED * stddev[one])[mask].any()
            for one, mask in zip(found.layout.further, found.layout.estimated, strict=True)
        ]
        if not any(moved) and _held(after, found.layout) is after:
            break
    return found


def _selected(
    members: Sequence[LiftedCamera], last: Iteration, *, estimate_line_delays: bool
) -> tuple[JointAdjustment, dict[CameraUnknown, Float64Array]]:
    """The unknowns that a round determines, and their predicted standard deviations (C,)."""
    every: BoolArray = np.ones(len(members), dtype=bool)
    layout = last.state.layout
    if not last.state.synchronised:
        layout = layout.with_unknown(CLOCK_SKEW, every)
    if estimate_line_delays:
        layout = layout.with_unknown(LINE_DELAY, every)
    chosen = last.state.layout
    stddev: dict[CameraUnknown, Float64Array] = {}
    if not layout.further:
        return JointAdjustment(last, chosen), stddev
    known = information(last.observations, last.state, layout, of_poses=False)
    last = _with_correlation(last, known.variance(layout))
    stddev |= _lens_stddevs(known, layout)
    skews, delays = None, None
    if estimate_line_delays:
        delays = select_line_delays(members, known, layout)
        layout = layout.estimating(LINE_DELAY, delays.estimated)
        stddev[LINE_DELAY] = delays.stddev
    if not last.state.synchronised:
        length_s = float(np.ptp(last.observations.time_bin)) * last.observations.step_s
        skews = select_skews(known, layout, last.timestamp_errors, length_s=length_s)
        chosen = chosen.with_unknown(CLOCK_SKEW, skews.estimated)
        stddev[CLOCK_SKEW] = skews.stddev
    if delays is not None:
        chosen = chosen.with_unknown(LINE_DELAY, delays.estimated)
    return JointAdjustment(last, chosen, skews, delays), stddev


def _with_correlation(last: Iteration, variance: float) -> Iteration:
    """The round with the weight that its keypoints have against what was known of its lenses."""
    if last.state.lenses is None:
        return last
    correlated = variance / noise_px(last.observations, last.state) ** 2
    lenses = replace(last.state.lenses, correlated=correlated)
    observations = replace(last.observations, lenses=lenses)
    return replace(last, observations=observations, state=replace(last.state, lenses=lenses))


def _lens_stddevs(known: Information, layout: ParameterLayout) -> dict[CameraUnknown, Float64Array]:
    of_lenses = [unknown for unknown in layout.further if unknown.row is not None]
    if not of_lenses:
        return {}
    variance = np.diag(known.covariance(layout))
    return {one: np.sqrt(variance[layout.scalars(one)]) for one in of_lenses}


def _held(last: Iteration, layout: ParameterLayout) -> Iteration:
    """The round with further unknowns at zero where they are not estimated."""
    estimated = dict(zip(layout.further, layout.estimated, strict=True))
    further = {
        one: np.where(estimated.get(one, False), value, 0.0)
        for one, value in last.state.further.items()
    }
    if all(np.array_equal(further[one], value) for one, value in last.state.further.items()):
        return last
    return replace(last, state=replace(last.state, further=further))


def _moved(before: Iteration, after: Iteration, unknown: CameraUnknown) -> Float64Array:
    one, other = (i.state.cameras.value(unknown) for i in (before, after))
    return np.asarray(other - one)
