"""Whether pose and clock of every camera stay the same throughout a recording.

A camera that is bumped, or whose clock is set while it records, is calibrated as it was for most of
the time: the rest counts as outliers, and the result looks good. Its residuals against time tell.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rejection import Rejection, RejectionReason
from stcalib_ros.core.validation.block_contrast import Contrast, largest_contrast
from stcalib_ros.core.validation.receipt_times import stamp_jumps
from stcalib_ros.core.validation.residual_series import (
    CLOCK,
    ROTATION,
    ChangeSeries,
    ResidualSource,
)
from stcalib_ros.core.validation.thresholds import (
    GAP_WINDOWS,
    LEAST_SCATTER,
    MAX_EVIDENCE_LEFT,
    MIN_CHANGE_SIGNIFICANCE,
    MIN_CLOCK_CHANGE_S,
    MIN_DISPLACEMENT,
    MIN_ROTATION_CHANGE,
    MIN_STEADINESS_WINDOWS,
    MIN_UNEXPLAINED_WINDOWS,
    UNEXPLAINED_PX,
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
        large = self.contrast.size > self.limit
        if self.reason is RejectionReason.POSE_CHANGED:
            large &= self.displacement > MIN_DISPLACEMENT
        return significant and large

    @property
    def displacement(self) -> float:
        """By how much it moves keypoints off their epipolar lines, RMS, over their noise."""
        n = self.series.n_points
        inside = int(n[self.contrast.begin : self.contrast.end].sum())
        outside = int(n.sum()) - inside
        return float(np.sqrt(self.contrast.evidence * (1.0 / inside + 1.0 / outside)))

    def rejection(self) -> Rejection:
        """What is wrong with the camera; times are those of the reference clock."""
        times, half = self.series.time_s, 0.5 * self.series.window_s
        begin, end = self.contrast.begin, self.contrast.end
        if begin == 0:  # of two parts of the recording, the later one
            begin, end = end, len(times)
        return Rejection(
            self.reason,
            measured=self.contrast.size,
            limit=self.limit,
            unit=self.unit,
            values={"begin_s": float(times[begin]) - half, "end_s": float(times[end - 1]) + half},
        )


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
    jumps = stamp_jumps(members)
    told = {c: one for c, one in suspects.items() if c in jumps and jumps[c].sudden}
    if len(suspects) == 2 and len(told) == 1:
        suspects = told
    found: list[Rejection | None] = [None] * len(members)
    lost = {} if suspects else _lost(series)
    for c in (*suspects, *lost):
        others = tuple(members[other].name for other in (*suspects, *lost) if other != c)
        why = suspects[c].rejection() if c in suspects else lost[c]
        why = _since_first_image(why, members[c], float(last.rig.offset_s[c]))
        if c in jumps and why.reason is RejectionReason.CLOCK_NOT_STEADY:
            why = replace(why, values={**why.values, "received_s": jumps[c].size_s})
        found[c] = replace(why, others=others)
    return tuple(found)


def _since_first_image(one: Rejection, camera: LiftedCamera, offset_s: float) -> Rejection:
    """The rejection of a camera of an offset, with times since its first image."""
    first_s = float(camera.stamps[0]) + offset_s
    return replace(one, values={name: time_s - first_s for name, time_s in one.values.items()})


def _lost(series: Sequence[ChangeSeries]) -> dict[int, Rejection]:
    """Return which camera no small change explains in a part of the recording: the worst one.

    Of two cameras, nothing says which.
    """
    found = {c: one for c, own in enumerate(series) if (one := _longest_lost(own)) is not None}
    worst = max((one.measured for one in found.values()), default=0.0)
    return {c: one for c, one in found.items() if len(series) == 2 or one.measured == worst}


def _longest_lost(series: ChangeSeries) -> Rejection | None:
    """The longest stretch of windows that no small change explains; None if it is short."""
    gaps = np.flatnonzero(np.diff(series.unexplained_s) > GAP_WINDOWS * series.window_s) + 1
    runs = np.split(np.arange(len(series.unexplained_s)), gaps)
    run = max(runs, key=len)
    if len(run) < MIN_UNEXPLAINED_WINDOWS or len(series.time_s) < MIN_UNEXPLAINED_WINDOWS:
        return None
    times, half = series.unexplained_s[run], 0.5 * series.window_s
    return Rejection(
        RejectionReason.PART_DISAGREES,
        measured=float(np.median(series.unexplained_px[run])),
        limit=UNEXPLAINED_PX,
        unit="px",
        values={"begin_s": float(times[0]) - half, "end_s": float(times[-1]) + half},
    )


def _suspects(
    source: ResidualSource, series: Sequence[ChangeSeries], changes: Mapping[int, _Change]
) -> dict[int, _Change]:
    """Return the cameras whose change alone would explain the residuals of all.

    One, but for two cameras, where nothing says which. That with the clearest change if no single
    one explains them.
    """
    if not changes:
        return {}
    clearest = max(changes.values(), key=lambda one: one.contrast.evidence)
    if len(series) == 2:
        return {c: changes.get(c, clearest) for c in range(2)}
    explained = MAX_EVIDENCE_LEFT * clearest.contrast.evidence
    alone = {
        c: one
        for c, one in changes.items()
        if _evidence_left(source.corrected(c, series[c])) < explained
    }
    return alone or {c: one for c, one in changes.items() if one is clearest}


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
    """The largest contrast of some parameters, whatever the others are.

    A clock may be set and set again. A camera that is moved stays moved; that it seems to be turned
    for a while is what keypoint bias does while people are at one side.
    """
    covariance = np.linalg.inv(series.information)[:, part, part]
    known = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    return largest_contrast(
        *(series.time_s, series.change[:, part], known),
        least_inflation=LEAST_SCATTER,
        one_border=part == ROTATION,
    )
