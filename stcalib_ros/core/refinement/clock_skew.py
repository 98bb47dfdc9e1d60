"""Clock skews: the drift of the time offsets over the recording.

Over time t the offset of a clock of skew s is ``delta + s (t - middle)``: a skew displaces a
keypoint as an offset does, times the time since the middle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.bundle.covariance import Information
from stcalib_ros.core.bundle.iteration import ClockSkews, Iteration, TimestampErrors
from stcalib_ros.core.bundle.parameters import CLOCK_SKEW, ParameterLayout
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.refinement.limits import (
    MAX_SIGNIFICANT_SKEW,
    MAX_SKEW_STDDEV,
    MIN_SKEW_DEVIATIONS,
    MIN_SKEW_DRIFT_S,
)


@dataclass(frozen=True, slots=True, eq=False)
class SkewSelection:
    """Cameras (C,) whose clock skews are estimated.

    Attributes
    ----------
    estimated : (C,) ndarray of bool
        The keypoints determine the trend of the timestamps.
    observable : (C,) ndarray of bool
        The trend is that of the clock.
    stddev : (C,) ndarray
        Predicted standard deviations.
    """

    estimated: BoolArray
    observable: BoolArray
    stddev: Float64Array


def select_skews(
    known: Information, layout: ParameterLayout, errors: TimestampErrors | None, *, length_s: float
) -> SkewSelection:
    """Select the skews that are known to 10 ppm, and those that are clearly not zero.

    The latter are those of images that are stamped by another rate than theirs, such as 29.97 Hz
    as 30 Hz. What the estimate would be follows from the normal equations.

    Where timestamps jitter, the line through their errors is no skew of a clock; it is estimated
    nevertheless if the keypoints determine it better than the timestamps do.

    Parameters
    ----------
    known : Information
    layout : ParameterLayout
        With the skews of all cameras.
    errors : TimestampErrors or None
    length_s : float
        Length of the recording, seconds.
    """
    P = known.covariance(layout)
    own = np.diag(P)[layout.scalars(CLOCK_SKEW)]
    trend = np.zeros_like(own) if errors is None else errors.skew_variance + errors.skew_variance[0]
    stddev = np.sqrt(own + trend)
    relative = np.arange(len(own)) > 0
    skew = np.abs(_predicted(known, layout))
    certain = (skew > MIN_SKEW_DEVIATIONS * stddev) & (skew * length_s > MIN_SKEW_DRIFT_S)
    observable = relative & (
        (stddev <= MAX_SKEW_STDDEV) | (certain & (skew < MAX_SIGNIFICANT_SKEW))
    )
    estimated = observable | (relative & (own < trend))
    return SkewSelection(estimated, observable, np.where(relative, stddev, 0.0))


def _predicted(known: Information, layout: ParameterLayout) -> Float64Array:
    """Skews (C,) after one Gauss-Newton step."""
    step = -layout.solve(known.system.H, known.system.g, known.cameras).ravel()
    return known.cameras.value(CLOCK_SKEW) + step[layout.scalars(CLOCK_SKEW)]


def clock_skews(
    last: Iteration, selection: SkewSelection, layout: ParameterLayout, P: Float64Array
) -> ClockSkews:
    """Skews of an adjusted round, with their standard deviations by its covariance P (n, n)."""
    stddev = selection.stddev
    if CLOCK_SKEW in layout.further:
        variance = np.diag(P)[layout.scalars(CLOCK_SKEW)]
        stddev = np.where(selection.observable, np.sqrt(variance), stddev)
    value = last.state.cameras.value(CLOCK_SKEW)
    skew = np.where(selection.observable, value, 0.0)
    return ClockSkews(skew, stddev, last.observations.middle_s)
