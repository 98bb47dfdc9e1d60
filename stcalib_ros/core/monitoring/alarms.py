"""From the findings of successive spans to a verdict on every camera."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from stcalib_ros.core.geometry.robust import RMS_OVER_MEDIAN
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.monitoring.change_detection import (
    CLOCK,
    N_CHANGES,
    ROTATION,
    SHIFT,
    Finding,
    explains,
)
from stcalib_ros.core.monitoring.drift import ClockHistory
from stcalib_ros.core.monitoring.limits import (
    CONFIRMING_SPANS,
    KEPT_SPANS,
    MAX_DISAGREEMENT,
    MAX_MATCHED_FRACTION,
    MAX_RESIDUAL_PX,
    MAX_RESIDUAL_RATIO,
    MIN_EXPECTED,
    MIN_GAIN_TO_CORRECT,
    MIN_MISSED_FRACTION,
    MIN_SPAN_EFFECT,
    MIN_SPAN_GAIN,
    MIN_TOTAL_GAIN,
    MIN_TOTAL_GAIN_WITH_SHIFT,
    RECENT_SPANS,
    UNMATCHED_SPANS,
)
from stcalib_ros.core.monitoring.spans import Span


class State(Enum):
    """State of a camera; the values appear in diagnostics."""

    UNKNOWN = "no data"
    OK = "ok"
    MOVED = "moved"
    CLOCK = "clock has jumped"
    DRIFTED = "clock has drifted"
    BOTH = "moved, and clock has jumped"
    UNMATCHED = "unmatched"
    STAMPS_OFF = "stamps off"
    NO_DETECTIONS = "no detections"

    @property
    def alarm(self) -> bool:
        """Whether the calibration is wrong for the camera, or can no longer be checked."""
        return self not in (State.UNKNOWN, State.OK)

    @property
    def changed(self) -> bool:
        """Whether the calibration is wrong for the camera."""
        return self.alarm and self is not State.NO_DETECTIONS


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Smallest change that raises an alarm.

    Attributes
    ----------
    rotation_deg : float
        Rotation of a camera; a displacement counts by the angle that it subtends at the people.
    clock_s : float
        Jump of its clock.
    """

    rotation_deg: float = 1.0
    clock_s: float = 0.05


@dataclass(frozen=True, slots=True)
class Verdict:
    """State of one camera with what was estimated.

    Attributes
    ----------
    name : str
    state : State
    rotation_deg, shift_m, clock_jump_s : float
        Estimated rotation, displacement and advance of its stamps; NaN where unknown.
    residual_px, expected_px : float
        Epipolar distance to the other cameras, root mean square: now, and when the calibration was
        made.
    since_s : float
        Time of the reference clock from which on all data is from after the last change (moving
        the camera back is one, too); NaN without a change.
    suspects : tuple of str
        Cameras of which one has changed, where it cannot be determined which; else empty.
    clock : ClockHistory
        What was known about its clock before an alarm.
    unknown_s : float
        Time before an alarm about the clock in which nothing was known of it; 0 if not long.
    """

    name: str
    state: State = State.UNKNOWN
    rotation_deg: float = math.nan
    shift_m: float = math.nan
    clock_jump_s: float = math.nan
    residual_px: float = math.nan
    expected_px: float = math.nan
    since_s: float = math.nan
    suspects: tuple[str, ...] = ()
    clock: ClockHistory = field(default_factory=ClockHistory)
    unknown_s: float = 0.0

    def sentence(self) -> str:
        """Return what has happened in words, to be followed by what to do."""
        who = " or ".join(self.suspects) if self.suspects else self.name
        turned = f"turned by {self.rotation_deg:.1f} degrees"
        if self.shift_m > 0:
            turned += f" and shifted by {self.shift_m:.2f} m"
        advance = f"by {1e3 * self.clock_jump_s:+.0f} ms"
        jumped = f"jumped {advance}"
        if self.unknown_s:
            jumped = f"jumped or drifted {advance} within {self.unknown_s / 60:.0f} minutes"
        usual = f"{self.expected_px:.0f} px are usual"
        residuals = f"{self.residual_px:.0f} px from the others, {usual}"
        return {
            State.UNKNOWN: f"{who} has not observed anybody whom other cameras observe, too",
            State.OK: f"{who} agrees with the calibration",
            State.MOVED: f"{who} has moved, as if {turned} ({residuals})",
            State.CLOCK: f"the clock of {who} has {jumped} ({residuals})",
            State.DRIFTED: (
                f"the clock of {who} has drifted {advance} ({residuals}): its rate is not known "
                "well enough (synchronise the clocks by NTP or PTP, or calibrate from a minute or "
                "more of people, by which rates are estimated)"
            ),
            State.BOTH: (
                f"{who} has moved, as if {turned}, and its clock has {jumped} ({residuals})"
            ),
            State.UNMATCHED: (
                f"{who} observes people who match nobody in the other cameras: it was moved far or "
                "replaced, or its clock is off by half a second or more"
            ),
            State.STAMPS_OFF: (
                f"the stamps of {who} are {abs(self.clock_jump_s):.1f} s "
                f"{'ahead of' if self.clock_jump_s > 0 else 'behind'} those of the others: "
                "its clock has jumped, or its images come late"
            ),
            State.NO_DETECTIONS: (
                f"{who} has no detections, though people should be in its view: it was turned away "
                "or covered, or its detector has stopped"
            ),
        }[self.state]


def judge(
    spans: Sequence[Span], before: Mapping[str, Verdict], thresholds: Thresholds
) -> dict[str, Verdict]:
    """Return the verdicts on all cameras after another span.

    An alarm needs the agreement of successive spans, and so does its end; in between, and while
    nobody is observed, the verdict stays as it is.

    Parameters
    ----------
    spans : sequence of Span
        The last `limits.KEPT_SPANS`, or fewer.
    before : mapping of str to Verdict
        Verdicts so far, of all cameras of the calibration.
    thresholds : Thresholds
    """
    return {name: _verdict(spans, verdict, thresholds) for name, verdict in before.items()}


def _verdict(spans: Sequence[Span], before: Verdict, thresholds: Thresholds) -> Verdict:
    name = before.name
    lead_s = [s.lead_s[name] for s in spans[-CONFIRMING_SPANS:] if name in s.lead_s]
    if len(lead_s) == CONFIRMING_SPANS:
        since_s = _since(spans[-1], before)
        return replace(
            Verdict(name, State.STAMPS_OFF, clock_jump_s=lead_s[-1], since_s=since_s),
            clock=before.clock,
        )
    own = [(span, span.findings[name]) for span in spans if name in span.findings]
    own = [(span, f) for span, f in own if f.fit.n_points or f.expected or f.missed]
    if not own:
        return before
    last = own[-1][1]
    measured = replace(
        before, residual_px=RMS_OVER_MEDIAN * last.fit.before_px, expected_px=last.expected_px
    )
    clear = [(span, f) for span, f in own if explains(f.fit, f.expected_px)]
    run = _run(clear, lambda f: _suspicious(f, thresholds))
    changed = _changed(run[-RECENT_SPANS:], measured, thresholds)
    found = changed or _gone(own, measured, thresholds) or _confirmed(own, measured, thresholds)
    return found if found.state.alarm else _with_clock(found, *own[-1])


def _with_clock(verdict: Verdict, span: Span, f: Finding) -> Verdict:
    """Add what the last span says about the clock to the history, once.

    Of two cameras that with the larger gain speaks for both: the other one was fitted with this
    one corrected.
    """
    known = f.fit.n_points and explains(f.fit, f.expected_px)
    if not known or verdict.clock.last_s == span.end_s:
        return verdict
    advance_s = -float(f.fit.change[CLOCK])
    if len(span.findings) == 2:
        (other,) = (found for name, found in span.findings.items() if name != verdict.name)
        advance_s = float(other.fit.change[CLOCK]) if other.fit.gain > f.fit.gain else advance_s
    return replace(verdict, clock=verdict.clock.after(span.end_s, advance_s))


def _gone(own: _Own, measured: Verdict, thresholds: Thresholds) -> Verdict | None:
    """Return an alarm if a camera is unmatched or without detections for long."""
    gone = _run(own, lambda f: _unmatched(f) or _clearly_changed(f, thresholds))
    if len(gone) >= UNMATCHED_SPANS and sum(_unmatched(f) for _, f in gone) >= CONFIRMING_SPANS:
        since_s = _since(gone[0][0], measured)
        return _alarm(measured, State.UNMATCHED, since_s, suspects=_pair(gone[-1][0]))
    missed = _run(own, lambda f: f.missed >= MIN_MISSED_FRACTION * f.n_steps)
    if len(missed) >= KEPT_SPANS and not measured.state.changed:
        return _alarm(measured, State.NO_DETECTIONS, _since(missed[0][0], measured))
    return None


def _confirmed(own: _Own, measured: Verdict, thresholds: Thresholds) -> Verdict:
    """Return that the calibration holds if the last spans confirm it, else the same verdict."""
    fine = _run(own, lambda f: not _suspicious(f, thresholds) and not _unmatched(f))
    evident = [(span, f) for span, f in fine if f.fit.n_points]
    if len(evident) < (CONFIRMING_SPANS if measured.state.alarm else 1):
        return measured
    since_s = evident[0][0].end_s if measured.state.alarm else measured.since_s
    change = evident[-1][1].fit.change
    return replace(
        _alarm(measured, State.OK, since_s),
        rotation_deg=math.degrees(float(np.linalg.norm(change[ROTATION]))),
        shift_m=float(np.linalg.norm(change[SHIFT])),
        clock_jump_s=-float(change[CLOCK]),
        clock=ClockHistory() if measured.state.alarm else measured.clock,
    )


_Own = Sequence[tuple[Span, Finding]]


def _run(own: _Own, holds: Callable[[Finding], bool]) -> _Own:
    """Return the latest spans in a row for which something holds."""
    n = next((n for n, (_, f) in enumerate(reversed(own)) if not holds(f)), len(own))
    return own[len(own) - n :]


def _unmatched(f: Finding) -> bool:
    """Whether nobody matches, or residuals are large and no change explains them."""
    nobody = f.expected >= MIN_EXPECTED and f.matched <= MAX_MATCHED_FRACTION * f.expected
    far = f.fit.before_px > max(MAX_RESIDUAL_RATIO * f.expected_px, MAX_RESIDUAL_PX)
    return (nobody and not f.fit.n_points) or (far and not explains(f.fit, f.expected_px))


def _effect(change: Float64Array, depth_m: float, thresholds: Thresholds) -> tuple[float, float]:
    """Return the size of a change of pose and of clock as multiples of the thresholds."""
    angle = float(np.linalg.norm(change[ROTATION]))
    shift = float(np.linalg.norm(change[SHIFT])) / depth_m if change[SHIFT].any() else 0.0
    return (
        max(angle, shift) / math.radians(thresholds.rotation_deg),
        abs(float(change[CLOCK])) / thresholds.clock_s,
    )


def _suspicious(f: Finding, thresholds: Thresholds) -> bool:
    effect = max(_effect(f.fit.change, f.depth_m, thresholds))
    return (
        f.fit.gain >= MIN_SPAN_GAIN and effect >= MIN_SPAN_EFFECT and explains(f.fit, f.expected_px)
    )


def _clearly_changed(f: Finding, thresholds: Thresholds) -> bool:
    """Whether a span shows a change strongly enough to belong to a run of unmatched ones."""
    return _suspicious(f, thresholds) and f.fit.gain > MIN_GAIN_TO_CORRECT


def _changed(run: _Own, measured: Verdict, thresholds: Thresholds) -> Verdict | None:
    """Return an alarm if suspicious spans add up to a change and the last ones agree on it."""
    gain = sum(f.fit.gain for _, f in run)
    shifted = any(f.fit.change[SHIFT].any() for _, f in run)
    needed = MIN_TOTAL_GAIN_WITH_SHIFT if shifted else MIN_TOTAL_GAIN
    if len(run) < CONFIRMING_SPANS or gain < needed:
        return None
    depth_m = float(np.median([f.depth_m for _, f in run]))
    if max(_effect(_combined([f for _, f in run]), depth_m, thresholds)) < 1.0:
        return None
    agreeing = _run(run, lambda f: _agree(f, run[-1][1], thresholds))
    if len(agreeing) < CONFIRMING_SPANS:
        return None
    change = _combined([f for _, f in agreeing])
    moved, jumped = _effect(change, depth_m, thresholds)
    state = State.MOVED if moved > jumped else State.CLOCK
    state = State.BOTH if min(moved, jumped) >= 1.0 else state
    if state is State.CLOCK and _drifted(measured, -float(change[CLOCK]), thresholds):
        state = State.DRIFTED
    rivals = frozenset.intersection(*(frozenset(f.rivals) for _, f in run))
    suspects = tuple(sorted({measured.name, *rivals})) if rivals else _pair(run[-1][0])
    first = agreeing[0][0]
    since_s = _since(first, measured) if len(agreeing) == len(run) else first.end_s
    return replace(
        _alarm(measured, state, since_s),
        rotation_deg=math.degrees(float(np.linalg.norm(change[ROTATION]))),
        shift_m=float(np.linalg.norm(change[SHIFT])),
        clock_jump_s=-float(change[CLOCK]),
        suspects=suspects,
        unknown_s=_unknown_s(measured, first),
    )


def _drifted(before: Verdict, advance_s: float, thresholds: Thresholds) -> bool:
    """Whether a clock has come that far little by little; once it has, until it jumps."""
    if before.state is State.DRIFTED:
        return abs(advance_s - before.clock_jump_s) < thresholds.clock_s
    return not before.state.alarm and before.clock.drifted(advance_s)


def _unknown_s(before: Verdict, first: Span) -> float:
    """Return the time before an alarm in which the clock was not observed; 0 if not long."""
    return before.unknown_s if before.state.alarm else before.clock.unknown_s(first.end_s)


def _pair(span: Span) -> tuple[str, ...]:
    """Return both cameras if there are two: it cannot be determined which one has changed."""
    return tuple(sorted(span.findings)) if len(span.findings) == 2 else ()


def _agree(a: Finding, b: Finding, thresholds: Thresholds) -> bool:
    """Whether two spans may show the same change, and not two, or a part of one."""
    difference = max(_effect(a.fit.change - b.fit.change, b.depth_m, thresholds))
    size = max(_effect(b.fit.change, b.depth_m, thresholds))
    return difference <= max(1.0, MAX_DISAGREEMENT * size)


def _combined(findings: Sequence[Finding]) -> Float64Array:
    """Return the mean change of several spans, weighted by their information matrices."""
    total, weighted = np.zeros((N_CHANGES, N_CHANGES)), np.zeros(N_CHANGES)
    for f in findings:
        total += f.fit.information
        weighted += f.fit.information @ f.fit.change
    known = total.diagonal() > 0
    out = np.zeros(N_CHANGES)
    out[known] = np.linalg.lstsq(total[np.ix_(known, known)], weighted[known], rcond=None)[0]
    return out


def _since(first: Span, before: Verdict) -> float:
    """Return the time from which on all data is from after the change."""
    return before.since_s if before.state.alarm else first.end_s


def _alarm(
    measured: Verdict, state: State, since_s: float, *, suspects: tuple[str, ...] = ()
) -> Verdict:
    return Verdict(
        measured.name,
        state,
        residual_px=measured.residual_px,
        expected_px=measured.expected_px,
        since_s=since_s,
        suspects=suspects,
        clock=measured.clock,
    )
