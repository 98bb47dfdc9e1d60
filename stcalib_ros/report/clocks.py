"""Clocks of the cameras: which time offsets fit, and whether they stay the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.capture.evidence import CaptureEvidence
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.options import Options
from stcalib_ros.core.validation.offset_ambiguity import OffsetCurves, offset_curves
from stcalib_ros.core.validation.residual_series import CLOCK, ChangeSeries, ResidualSource

_MOST_ROWS = 4000
"""Persons at moments that offsets are compared on; of more, the middle part. Cost alone."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraClock:
    """What the residuals of one camera say about its clock.

    Attributes
    ----------
    name : str
    difference_s, error : (S,) ndarray
        Other time offsets, as differences from the one found, and their error over its error.
    runner_up : int
        Position of the best other minimum; -1 if there is none.
    time_s, change_s : (K,) ndarray
        How the offset that fits best in a window of time differs from its median over all; times
        by the reference clock, seconds since `Recording.epoch_ns`.
    """

    name: str
    difference_s: Float64Array
    error: Float64Array
    runner_up: int
    time_s: Float64Array
    change_s: Float64Array

    @property
    def ratio(self) -> float:
        """How many times the error of the runner-up is that of the offset found; NaN without."""
        return float(self.error[self.runner_up]) if self.runner_up >= 0 else float("nan")


def camera_clocks(
    evidence: CaptureEvidence | None, names: Sequence[str], reference: str, options: Options
) -> tuple[CameraClock, ...]:
    """Return the clocks of some cameras, in their order, but for the reference."""
    if evidence is None:
        return ()
    last = evidence.last
    curves = offset_curves(_middle(last), range_s=options.offset_range_s)
    source = ResidualSource.of(evidence.lifted, last)
    clocks = []
    for name in (name for name in names if name in evidence.names and name != reference):
        c = evidence.names.index(name)
        clocks.append(_clock(name, c, curves, source.series(c)))
    return tuple(clocks)


def _clock(name: str, c: int, curves: OffsetCurves, series: ChangeSeries) -> CameraClock:
    change_s = series.change[:, CLOCK].ravel()
    usual_s = float(np.median(change_s)) if len(change_s) else 0.0
    return CameraClock(
        name=name,
        difference_s=curves.difference_s,
        error=curves.error[c],
        runner_up=curves.runner_up(c),
        time_s=series.time_s,
        change_s=change_s - usual_s,
    )


def _middle(last: Iteration) -> Iteration:
    """Return the same with the middle part of a long recording alone."""
    obs = last.observations
    if len(obs.person) <= _MOST_ROWS:
        return last
    order = np.sort(obs.time_bin)
    spare = (len(order) - _MOST_ROWS) // 2
    rows = (obs.time_bin >= order[spare]) & (obs.time_bin <= order[-1 - spare])
    return replace(last, observations=obs.only(rows), state=last.state.only(rows))
