"""Whether pose and clock of every camera stay the same throughout a recording.

A camera that is bumped, or whose clock is set while it records, is calibrated as it was for most of
the time: the rest counts as outliers, and the result looks good. Its residuals against time tell.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rejection import Rejection, RejectionReason
from stcalib_ros.core.validation.block_contrast import Contrast, largest_contrast
from stcalib_ros.core.validation.residual_series import (
    CLOCK,
    ROTATION,
    ChangeSeries,
    ResidualSource,
)
from stcalib_ros.core.validation.thresholds import (
    LEAST_SCATTER,
    MAX_EVIDENCE_LEFT,
    MIN_CHANGE_SIGNIFICANCE,
    MIN_CLOCK_CHANGE_S,
    MIN_ROTATION_CHANGE,
    MIN_STEADINESS_WINDOWS,
)


@dataclass(frozen=True, slots=True, eq=False)
class _Change:
    """A change of one camera within a recording."""

    reason: RejectionReason
    limit: float
    unit: str
    contrast: Contrast
    series: ChangeSeries

    @property
    def certain(self) -> bool:
        """Whether it is no chance, and large enough to matter."""
        significant = self.contrast.significance > MIN_CHANGE_SIGNIFICANCE
        return significant and self.contrast.size > self.limit

    def rejection(
        self, camera: LiftedCamera, offset_s: float, others: tuple[str, ...]
    ) -> Rejection:
        """What is wrong with a camera, whose time offset is given."""
        begin_s, end_s = self._stretch()
        first_s = float(camera.stamps[0]) + offset_s
        return Rejection(
            self.reason,
            measured=self.contrast.size,
            limit=self.limit,
            unit=self.unit,
            others=others,
            values={"begin_s": begin_s - first_s, "end_s": end_s - first_s},
        )

    def _stretch(self) -> tuple[float, float]:
        """Begin and end of what differs; of two parts of the recording, the later one."""
        times, half = self.series.time_s, 0.5 * float(np.diff(self.series.time_s).min())
        begin, end = self.contrast.begin, self.contrast.end
        if begin == 0:
            begin, end = end, len(times)
        return float(times[begin]) - half, float(times[end - 1]) + half


def unsteady_cameras(
    cameras: Sequence[LiftedCamera], last: Iteration
) -> tuple[Rejection | None, ...]:
    """Return how the pose or the clock of a camera changes within the recording.

    Of the one camera whose change explains the residuals of all: it disturbs the others as well,
    which are looked at once it is left out.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    last : Iteration
    """
    members = [cameras[c] for c in last.rig.cameras]
    source = ResidualSource.of(cameras, last)
    series = [source.series(c) for c in range(len(members))]
    changes = {c: one for c, own in enumerate(series) if (one := _largest(own)) is not None}
    suspects = _suspects(source, series, changes)
    found: list[Rejection | None] = [None] * len(members)
    for c in suspects:
        others = tuple(members[other].name for other in suspects if other != c)
        found[c] = changes[c].rejection(members[c], float(last.rig.offset_s[c]), others)
    return tuple(found)


def _suspects(
    source: ResidualSource, series: Sequence[ChangeSeries], changes: Mapping[int, _Change]
) -> list[int]:
    """Return the cameras whose change alone would explain the residuals of all.

    One, but for two cameras, where nothing says which. That with the clearest change if no single
    one explains them.
    """
    most = max((one.contrast.evidence for one in changes.values()), default=0.0)
    explained = MAX_EVIDENCE_LEFT * most
    alone = [c for c in changes if _evidence_left(source.corrected(c, series[c])) < explained]
    return alone or [c for c, one in changes.items() if one.contrast.evidence == most]


def _evidence_left(source: ResidualSource) -> float:
    """Evidence for the clearest change of any camera."""
    every = [_changes(source.series(c)) for c in range(len(source.rig.cameras))]
    return max((one.contrast.evidence for own in every for one in own), default=0.0)


def _largest(series: ChangeSeries) -> _Change | None:
    """Return the clearest change of a camera that is certain; None if there is none."""
    certain = [one for one in _changes(series) if one.certain]
    return max(certain, key=lambda one: one.contrast.evidence, default=None)


def _changes(series: ChangeSeries) -> list[_Change]:
    """Return the largest changes of a camera's clock and pose, certain or not."""
    if len(series.time_s) < MIN_STEADINESS_WINDOWS:
        return []
    reason = RejectionReason
    return [
        _Change(code, limit, unit, _contrast(series, part), series)
        for code, part, limit, unit in (
            (reason.CLOCK_NOT_STEADY, CLOCK, MIN_CLOCK_CHANGE_S, "s"),
            (reason.POSE_CHANGED, ROTATION, MIN_ROTATION_CHANGE, "rad"),
        )
    ]


def _contrast(series: ChangeSeries, part: slice) -> Contrast:
    """The largest contrast of some parameters, whatever the others are."""
    covariance = np.linalg.inv(series.information)[:, part, part]
    known = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    return largest_contrast(
        series.time_s, series.change[:, part], known, least_inflation=LEAST_SCATTER
    )
