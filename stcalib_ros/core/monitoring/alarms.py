"""From what span after span says to a verdict on every camera, which takes more than one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from stcalib_ros.core.geometry.robust import RMS_OVER_MEDIAN
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.monitoring.change_detection import (
    CLOCK,
    ROTATION,
    SHIFT,
    Finding,
    explains,
)
from stcalib_ros.core.monitoring.limits import (
    CONFIRMING_SPANS,
    DISAGREEMENT_PX,
    DISAGREEMENT_RATIO,
    MAX_MATCHED_FRACTION,
    MIN_EXPECTED,
    MIN_GAIN,
    MIN_SHIFT_GAIN,
    MIN_SPAN_GAIN,
    NO_DETECTIONS_FRACTION,
    SUSPICIOUS_FRACTION,
    UNMATCHED_SPANS,
)
from stcalib_ros.core.monitoring.spans import Span

KEPT_SPANS = 5
"""Spans that are looked at for a verdict, and in a row without detections for one. Chosen: ten
seconds; on simulated changes of benchmarks.live.watch."""
_RECENT = 4
"""Latest suspicious spans in a row that are added up. Numerical: one less than are kept."""


class State(Enum):
    """What is known of a camera; the values go to diagnostics."""

    UNKNOWN = "nobody to check it by"
    OK = "ok"
    MOVED = "moved"
    CLOCK = "clock has jumped"
    BOTH = "moved, and clock has jumped"
    LOST = "matches nobody any more"
    AWAY = "stamps are far from those of the others"
    BLIND = "sees nobody"

    @property
    def alarm(self) -> bool:
        """The calibration does not hold for the camera, or it cannot be told any more."""
        return self not in (State.UNKNOWN, State.OK)

    @property
    def changed(self) -> bool:
        """The calibration does not hold for the camera."""
        return self.alarm and self is not State.BLIND


@dataclass(frozen=True, slots=True)
class Thresholds:
    """From which change on there is an alarm.

    Attributes
    ----------
    rotation_deg : float
        Turn of a camera; a displacement counts by the angle that it makes at the people.
    clock_s : float
    """

    rotation_deg: float = 1.0
    clock_s: float = 0.05


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is known of one camera.

    Attributes
    ----------
    name : str
    state : State
    rotation_deg, shift_m, clock_jump_s : float
        Turn, displacement and what its stamps have more, as measured; NaN where unknown.
    residual_px, promised_px : float
        Epipolar distance to the other cameras, root mean square: now, and by the calibration.
    since_s : float
        From this stamp on (reference clock) all data is from after the last change, be it that the
        camera was put back; NaN if nothing has happened to it.
    suspects : tuple of str
        It is one of these cameras, and what they see does not tell which; empty if it is known.
    """

    name: str
    state: State = State.UNKNOWN
    rotation_deg: float = math.nan
    shift_m: float = math.nan
    clock_jump_s: float = math.nan
    residual_px: float = math.nan
    promised_px: float = math.nan
    since_s: float = math.nan
    suspects: tuple[str, ...] = ()

    def sentence(self) -> str:
        """For a person: what has happened; to be followed by what to do."""
        who = " or ".join(self.suspects) if self.suspects else self.name
        turned = f"turned by {self.rotation_deg:.1f} degrees"
        if self.shift_m > 0:
            turned += f" and shifted by {self.shift_m:.2f} m"
        jumped = f"jumped by {1e3 * self.clock_jump_s:+.0f} ms"
        usual = f"{self.promised_px:.0f} px are usual"
        residuals = f"{self.residual_px:.0f} px from the others, {usual}"
        return {
            State.UNKNOWN: f"{who}: nobody was seen whom others see, too",
            State.OK: f"{who} agrees with the calibration",
            State.MOVED: f"{who} has moved, as if {turned} ({residuals})",
            State.CLOCK: f"the clock of {who} has {jumped} ({residuals})",
            State.BOTH: (
                f"{who} has moved, as if {turned}, and its clock has {jumped} ({residuals})"
            ),
            State.LOST: (
                f"{who} matches nobody any more: moved far, replaced, or its clock is off by much"
            ),
            State.AWAY: (
                f"the stamps of {who} are {abs(self.clock_jump_s):.1f} s "
                f"{'ahead of' if self.clock_jump_s > 0 else 'behind'} those of the others: "
                "its clock has jumped, or its images come late"
            ),
            State.BLIND: (
                f"{who} sees nobody, though people should be in its view: turned away, covered, "
                "or its detector has stopped"
            ),
        }[self.state]


def judge(
    spans: Sequence[Span], before: Mapping[str, Verdict], thresholds: Thresholds
) -> dict[str, Verdict]:
    """Verdicts on all cameras after another span.

    An alarm needs the agreement of successive spans, and so does its end; in between, and while
    nobody is seen, things stay as they are.

    Parameters
    ----------
    spans : sequence of Span
        The last `KEPT_SPANS`, or fewer.
    before : mapping of str to Verdict
        The verdicts until now, of all cameras of the calibration.
    thresholds : Thresholds
    """
    return {name: _verdict(spans, verdict, thresholds) for name, verdict in before.items()}


def _verdict(spans: Sequence[Span], before: Verdict, thresholds: Thresholds) -> Verdict:
    name = before.name
    away_s = [s.away_s[name] for s in spans[-CONFIRMING_SPANS:] if name in s.away_s]
    if len(away_s) == CONFIRMING_SPANS:
        since_s = _since(spans[-1], before)
        return Verdict(name, State.AWAY, clock_jump_s=away_s[-1], since_s=since_s)
    own = [(span, span.findings[name]) for span in spans if name in span.findings]
    own = [(span, f) for span, f in own if f.fit.n_points or f.expected or f.blind]
    if not own:
        return before
    last = own[-1][1]
    measured = replace(
        before, residual_px=RMS_OVER_MEDIAN * last.fit.before_px, promised_px=last.promised_px
    )
    run = _run(own, lambda f: _suspicious(f, thresholds))
    changed = _changed(run[-_RECENT:], measured, thresholds)
    return changed or _gone(own, measured, thresholds) or _calmed(own, measured, thresholds)


def _gone(own: _Own, measured: Verdict, thresholds: Thresholds) -> Verdict | None:
    """Alarm if a camera matches nobody or sees nobody for longer than chance has it."""
    lost = _run(own, lambda f: _lost(f) or (_suspicious(f, thresholds) and f.fit.gain > 1.0))
    if len(lost) >= UNMATCHED_SPANS and sum(_lost(f) for _, f in lost) >= CONFIRMING_SPANS:
        since_s = _since(lost[0][0], measured)
        return _alarm(measured, State.LOST, since_s, suspects=_pair(lost[-1][0]))
    blind = _run(own, lambda f: f.blind >= NO_DETECTIONS_FRACTION * f.moments)
    if len(blind) >= KEPT_SPANS and not measured.state.changed:
        return _alarm(measured, State.BLIND, _since(blind[0][0], measured))
    return None


def _calmed(own: _Own, measured: Verdict, thresholds: Thresholds) -> Verdict:
    """All is well if the last spans say so; else things stay as they are."""
    fine = _run(own, lambda f: not _suspicious(f, thresholds) and not _lost(f))
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
    )


_Own = Sequence[tuple[Span, Finding]]


def _run(own: _Own, holds: Callable[[Finding], bool]) -> _Own:
    """The latest spans in a row for which something holds."""
    n = _run_of([holds(f) for _, f in own])
    return own[len(own) - n :]


def _run_of(values: Sequence[bool]) -> int:
    return next((n for n, value in enumerate(reversed(values)) if not value), len(values))


def _lost(f: Finding) -> bool:
    unmatched = f.expected >= MIN_EXPECTED and f.matched <= MAX_MATCHED_FRACTION * f.expected
    far = f.fit.before_px > max(DISAGREEMENT_RATIO * f.promised_px, DISAGREEMENT_PX)
    return (unmatched and not f.fit.n_points) or (far and not explains(f.fit, f.promised_px))


def _effect(change: Float64Array, depth_m: float, thresholds: Thresholds) -> tuple[float, float]:
    """Size of a change of the pose and of the clock, in units of the thresholds."""
    angle = float(np.linalg.norm(change[ROTATION]))
    shift = float(np.linalg.norm(change[SHIFT])) / depth_m if change[SHIFT].any() else 0.0
    return (
        max(angle, shift) / math.radians(thresholds.rotation_deg),
        abs(float(change[CLOCK])) / thresholds.clock_s,
    )


def _suspicious(f: Finding, thresholds: Thresholds) -> bool:
    effect = max(_effect(f.fit.change, f.depth_m, thresholds))
    large = f.fit.gain >= MIN_SPAN_GAIN and effect >= SUSPICIOUS_FRACTION
    return large and explains(f.fit, f.promised_px)


def _changed(run: _Own, measured: Verdict, thresholds: Thresholds) -> Verdict | None:
    """Alarm if a run of suspicious spans adds up to a change, and the last ones agree on it."""
    gain = sum(f.fit.gain for _, f in run)
    needed = MIN_SHIFT_GAIN if any(f.fit.change[SHIFT].any() for _, f in run) else MIN_GAIN
    if len(run) < CONFIRMING_SPANS or gain < needed:
        return None
    depth_m = float(np.median([f.depth_m for _, f in run]))
    if max(_effect(_combined([f for _, f in run]), depth_m, thresholds)) < 1.0:
        return None
    alike = _run(run, lambda f: _alike(f, run[-1][1], thresholds))
    if len(alike) < CONFIRMING_SPANS:
        return None
    change = _combined([f for _, f in alike])
    moved, jumped = _effect(change, depth_m, thresholds)
    state = State.MOVED if moved > jumped else State.CLOCK
    state = State.BOTH if min(moved, jumped) >= 1.0 else state
    rivals = frozenset.intersection(*(frozenset(f.rivals) for _, f in run))
    suspects = tuple(sorted({measured.name, *rivals})) if rivals else _pair(run[-1][0])
    since_s = _since(alike[0][0], measured) if len(alike) == len(run) else alike[0][0].end_s
    return replace(
        _alarm(measured, state, since_s),
        rotation_deg=math.degrees(float(np.linalg.norm(change[ROTATION]))),
        shift_m=float(np.linalg.norm(change[SHIFT])),
        clock_jump_s=-float(change[CLOCK]),
        suspects=suspects,
    )


def _pair(span: Span) -> tuple[str, ...]:
    """Two cameras, if there are no more: it cannot be told which of them has changed."""
    return tuple(sorted(span.findings)) if len(span.findings) == 2 else ()


def _alike(a: Finding, b: Finding, thresholds: Thresholds) -> bool:
    """Whether two spans may show one change, and not two, or a part of one."""
    apart = max(_effect(a.fit.change - b.fit.change, b.depth_m, thresholds))
    size = max(_effect(b.fit.change, b.depth_m, thresholds))
    return apart <= max(1.0, SUSPICIOUS_FRACTION * size)


def _combined(findings: Sequence[Finding]) -> Float64Array:
    """Changes of several spans, averaged with the weights of what each one knows."""
    total, weighted = np.zeros((7, 7)), np.zeros(7)
    for f in findings:
        total += f.fit.information
        weighted += f.fit.information @ f.fit.change
    known = total.diagonal() > 0
    out = np.zeros(7)
    out[known] = np.linalg.lstsq(total[np.ix_(known, known)], weighted[known], rcond=None)[0]
    return out


def _since(first: Span, before: Verdict) -> float:
    """All data is from after the change from the end of the first span that shows it."""
    return before.since_s if before.state.alarm else first.end_s


def _alarm(
    measured: Verdict, state: State, since_s: float, *, suspects: tuple[str, ...] = ()
) -> Verdict:
    return Verdict(
        measured.name,
        state,
        residual_px=measured.residual_px,
        promised_px=measured.promised_px,
        since_s=since_s,
        suspects=suspects,
    )
