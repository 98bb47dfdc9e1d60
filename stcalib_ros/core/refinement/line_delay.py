"""Line delays of rolling shutters: people who move are distorted as rows are read in turn.

A line delay displaces a keypoint as a time offset does, times the row of the keypoint. Where people
move in front of cameras that observe them in different rows, the line delays follow from the same
residuals as the offsets; those that are not observable stay as given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.bundle.covariance import Information
from stcalib_ros.core.bundle.iteration import Iteration, LineDelays
from stcalib_ros.core.bundle.parameters import LINE_DELAY, ParameterLayout
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rolling_shutter import MAX_READOUT_STDDEV_S


@dataclass(frozen=True, slots=True, eq=False)
class DelaySelection:
    """Cameras (C,) whose line delays are estimated, and predicted standard deviations of all."""

    estimated: BoolArray
    stddev: Float64Array


def select_line_delays(
    members: Sequence[LiftedCamera], known: Information, layout: ParameterLayout
) -> DelaySelection:
    """Select the line delays that the keypoints determine well enough.

    What all of them have in common is determined less than their differences: to hold one that is
    not known would bias the others. All that are observable by themselves are estimated, or none.

    Parameters
    ----------
    members : sequence of LiftedCamera
    known : Information
    layout : ParameterLayout
        With the line delays of all cameras.
    """
    largest = MAX_READOUT_STDDEV_S / np.array([m.shutter.height for m in members])

    def stddev(estimated: BoolArray) -> Float64Array:
        P = known.covariance(layout.estimating(LINE_DELAY, estimated))
        return np.sqrt(np.diag(P)[layout.scalars(LINE_DELAY)])

    C = len(members)
    alone = np.array([stddev(one)[c] for c, one in enumerate(np.eye(C, dtype=bool))])
    able = alone <= largest
    estimated = able & bool((stddev(able) <= largest).all())
    predicted = np.where(estimated, stddev(estimated), stddev(np.ones(C, dtype=bool)))
    return DelaySelection(estimated, predicted)


def line_delays(
    members: Sequence[LiftedCamera],
    last: Iteration,
    selection: DelaySelection,
    layout: ParameterLayout,
    P: Float64Array,
) -> LineDelays:
    """Line delays of an adjusted round, standard deviations by its covariance P (n, n)."""
    given = np.asarray(last.observations.line_s)
    correction = last.state.cameras.value(LINE_DELAY)
    stddev = selection.stddev
    if LINE_DELAY in layout.further:
        variance = np.diag(P)[layout.scalars(LINE_DELAY)]
        stddev = np.where(selection.estimated, np.sqrt(variance), stddev)
    late = correction * middle_rows(members)
    return LineDelays(given + correction, stddev, late[0] - late)


def middle_rows(members: Sequence[LiftedCamera]) -> Float64Array:
    """Rows (C,), px, that the times of the images of some cameras are of."""
    return np.array([m.shutter.middle_row for m in members])
