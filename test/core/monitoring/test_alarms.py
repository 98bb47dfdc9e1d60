"""From spans to verdicts: what makes an alarm, what does not, and what ends it."""

import math

import numpy as np
import pytest

from stcalib_ros.core.monitoring.alarms import State, Thresholds, Verdict, judge
from stcalib_ros.core.monitoring.change_detection import ChangeFit, Finding
from stcalib_ros.core.monitoring.limits import KEPT_SPANS, SPAN_S
from stcalib_ros.core.monitoring.spans import Span

NAMES = ("cam0", "cam1", "cam2")
INFORMATION = np.diag([1e5, 1e5, 1e5, 1e4, 1e4, 1e4, 1e4])
K = 10


def finding(
    turn_deg=0.0,
    *,
    shift_m=0.0,
    clock_s=0.0,
    gain=0.0,
    after_px=4.0,
    matched=K,
    missed=0,
    rivals=(),
    n_points=500,
):
    change = np.array([0.0, math.radians(turn_deg), 0.0, shift_m, 0.0, 0.0, clock_s])
    before_px = after_px + 10.0 * (gain > 0.5)
    left_px = np.full(len(NAMES), after_px)
    fit = ChangeFit(change, INFORMATION, before_px, after_px, gain, n_points, left_px)
    return Finding(fit, 6.0, 4.0, K, K - missed, matched, missed, tuple(rivals))


GOOD = finding()
TURNED = finding(2.0, gain=4.0)
JUMPED = finding(clock_s=-0.1, gain=4.0)
UNMATCHED = finding(matched=0, n_points=0)
DISAGREES = finding(after_px=35.0)
NO_DETECTIONS = finding(matched=0, missed=K, n_points=0)
NOBODY = finding(matched=0, n_points=0)
NOBODY = Finding(NOBODY.fit, 6.0, math.nan, K, 0, 0, 0)


def verdicts_on(*findings, thresholds=None, others=GOOD, lead=()):
    """Verdicts on cam1 after each of its findings; None: it has no images."""
    verdicts = {name: Verdict(name) for name in NAMES}
    spans, out = [], []
    for k, own in enumerate(findings):
        found = dict.fromkeys(NAMES, others) | {"cam1": own}
        found = {name: f for name, f in found.items() if f is not None}
        lead_s = {"cam1": lead[k]} if k < len(lead) and lead[k] else {}
        spans = [*spans, Span(SPAN_S * k, SPAN_S * (k + 1), found, lead_s)][-KEPT_SPANS:]
        verdicts = judge(spans, verdicts, thresholds or Thresholds())
        assert not others or not any(verdicts[n].state.alarm for n in ("cam0", "cam2"))
        out.append(verdicts["cam1"])
    return out


def states(*findings, **given):
    return [verdict.state for verdict in verdicts_on(*findings, **given)]


def test_one_strange_span_is_no_alarm():
    assert states(GOOD, TURNED, GOOD, TURNED, GOOD) == [State.OK] * 5


def test_two_that_agree_are():
    last = verdicts_on(GOOD, TURNED, TURNED)[-1]
    assert last.state is State.MOVED
    assert last.rotation_deg == pytest.approx(2.0)
    assert last.since_s == 2 * SPAN_S
    assert "cam1 has moved, as if turned by 2.0 degrees" in last.sentence()
    assert last.residual_px == pytest.approx(1.48 * 14.0)


def test_a_clock():
    last = verdicts_on(GOOD, JUMPED, JUMPED)[-1]
    assert (last.state, last.clock_jump_s) == (State.CLOCK, pytest.approx(0.1))
    assert "the clock of cam1 has jumped by +100 ms" in last.sentence()


def test_both():
    both = finding(2.0, clock_s=0.2, gain=5.0)
    assert states(GOOD, both, both)[-1] is State.BOTH


def test_spans_that_contradict_each_other_are_no_alarm():
    assert State.MOVED not in states(*[TURNED, finding(-2.0, gain=4.0)] * 3)


@pytest.mark.parametrize(
    "weak",
    [finding(0.9, gain=9.0), finding(2.0, gain=0.2), finding(clock_s=0.04, gain=9.0)],
    ids=["small", "not significant", "short"],
)
def test_size_and_significance_are_both_needed(weak):
    assert not any(state.alarm for state in states(*[weak] * 6))


def test_thresholds_can_be_changed():
    fine = Thresholds(rotation_deg=0.5, clock_s=0.05)
    assert states(*[finding(0.9, gain=4.0)] * 2, thresholds=fine)[-1] is State.MOVED


def test_weak_evidence_adds_up():
    assert states(*[finding(2.0, gain=0.6)] * 4) == [*[State.UNKNOWN] * 3, State.MOVED]


def test_a_span_that_nothing_explains_neither_is_evidence_nor_against_it():
    weak = finding(2.0, gain=0.9)
    assert states(GOOD, weak, DISAGREES, weak, weak)[-1] is State.MOVED
    assert not any(state.alarm for state in states(GOOD, weak, DISAGREES, GOOD, weak))


def test_a_displacement_beside_a_turn_needs_more_evidence():
    shifted = finding(1.2, shift_m=0.08, gain=0.9)
    assert not any(state.alarm for state in states(*[shifted] * 8))
    clear = finding(1.2, shift_m=0.08, gain=3.5)
    assert states(clear, clear)[-1] is State.MOVED
    assert "and shifted by 0.08 m" in verdicts_on(clear, clear)[-1].sentence()


def test_data_of_the_span_of_the_change_is_not_used():
    part = finding(0.7, gain=0.5)
    assert verdicts_on(GOOD, part, TURNED, TURNED)[-1].since_s == 3 * SPAN_S


def test_a_camera_that_moves_on_starts_anew():
    more = finding(9.0, gain=6.0)
    verdicts = verdicts_on(GOOD, TURNED, TURNED, more, more, more)
    assert verdicts[2].since_s == 2 * SPAN_S
    assert verdicts[-1].since_s == 4 * SPAN_S


def test_it_ends_when_the_camera_is_moved_back():
    verdicts = verdicts_on(TURNED, TURNED, GOOD, GOOD, GOOD)
    assert [v.state for v in verdicts[1:]] == [State.MOVED, State.MOVED, State.OK, State.OK]
    assert verdicts[-1].since_s == 3 * SPAN_S


def test_it_stays_while_nobody_is_observed():
    assert states(TURNED, TURNED, *[NOBODY] * 8)[-1] is State.MOVED
    assert states(GOOD, *[NOBODY] * 8)[-1] is State.OK
    assert states(*[NOBODY] * 3)[-1] is State.UNKNOWN
    assert states(*[None] * 3)[-1] is State.UNKNOWN


@pytest.mark.parametrize("gone", [UNMATCHED, DISAGREES], ids=["unmatched", "disagrees"])
def test_a_camera_that_matches_nobody_for_long_raises_an_alarm(gone):
    found = verdicts_on(GOOD, gone, gone, gone)
    assert [v.state for v in found] == [State.OK, State.OK, State.OK, State.UNMATCHED]
    assert found[-1].since_s == 2 * SPAN_S


def test_noisy_detections_are_no_motion():
    noisy = finding(0.6, gain=0.4, after_px=15.0)
    assert not any(state.alarm for state in states(*[noisy] * 8))


def test_a_camera_without_detections_for_very_long_raises_an_alarm():
    found = states(GOOD, *[NO_DETECTIONS] * KEPT_SPANS)
    assert found[-2:] == [State.OK, State.NO_DETECTIONS]
    assert not State.NO_DETECTIONS.changed
    assert states(TURNED, TURNED, *[NO_DETECTIONS] * 9)[-1] is State.MOVED, "what is known stays so"


@pytest.mark.parametrize("ppm", [20.0, 1000.0, -1000.0])
def test_a_clock_that_runs_at_another_rate_has_drifted(ppm):
    until_s = 1.3 * 0.05 / abs(1e-6 * ppm)
    advances = 1e-6 * ppm * np.arange(0.0, until_s, max(SPAN_S, until_s / 100))
    drifting = [finding(clock_s=-a, gain=4.0 * (abs(a) > 0.02)) for a in advances]
    found = verdicts_on(*drifting)
    first = next(v for v in found if v.state.alarm)
    assert first.state is found[-1].state is State.DRIFTED
    assert abs(first.clock_jump_s) == pytest.approx(0.05, rel=0.15)
    assert "the clock of cam1 has drifted by" in first.sentence()
    assert first.state.changed


def test_of_two_cameras_the_drift_is_seen_in_whichever_was_fitted():
    """Each is fitted in every other span; the other one is corrected by it."""
    verdicts, spans = {name: Verdict(name) for name in ("cam0", "cam1")}, []
    for k, advance_s in enumerate(np.linspace(0.0, 0.07, 40)):
        own = finding(clock_s=-advance_s, gain=4.0 * (advance_s > 0.02) + 0.1, rivals=["cam0"])
        other = finding(clock_s=advance_s, gain=0.9 * own.fit.gain, rivals=["cam1"])
        silent = finding(gain=0.0)
        pair = (silent, own) if k % 2 and advance_s < 0.04 else (other, own)
        found = dict(zip(("cam0", "cam1"), pair, strict=True))
        spans = [*spans, Span(SPAN_S * k, SPAN_S * (k + 1), found)][-KEPT_SPANS:]
        verdicts = judge(spans, verdicts, Thresholds())
        assert not any(v.state is State.CLOCK for v in verdicts.values())
    assert {v.state for v in verdicts.values()} == {State.DRIFTED}


def test_a_jump_after_a_drift_is_a_jump():
    drifting = [finding(clock_s=-a, gain=4.0 * (a > 0.02)) for a in np.linspace(0.0, 0.07, 40)]
    jumped = finding(clock_s=-0.4, gain=9.0)
    found = states(*drifting, jumped, jumped)
    assert State.DRIFTED in found
    assert State.CLOCK not in found[: len(drifting)]
    assert found[-1] is State.CLOCK


def test_after_a_night_without_people_it_may_be_either():
    verdicts, spans = {name: Verdict(name) for name in NAMES}, []
    for start_s, own in ((0.0, GOOD), (2.0, GOOD), (36e3, JUMPED), (36e3 + 2.0, JUMPED)):
        found = dict.fromkeys(NAMES, GOOD) | {"cam1": own}
        spans = [*spans, Span(start_s, start_s + SPAN_S, found)][-KEPT_SPANS:]
        verdicts = judge(spans, verdicts, Thresholds())
    assert verdicts["cam1"].state is State.CLOCK
    assert "has jumped or drifted by +100 ms within 600 minutes" in verdicts["cam1"].sentence()
    assert "minutes" not in verdicts_on(GOOD, JUMPED, JUMPED)[-1].sentence()


def test_two_cameras_name_each_other():
    one, other = finding(2.0, gain=4.0, rivals=["cam0"]), finding(2.0, gain=4.0, rivals=["cam1"])
    spans = [
        Span(0.0, 2.0, {"cam1": one, "cam0": other}),
        Span(2.0, 4.0, {"cam1": one, "cam0": other}),
    ]
    found = judge(spans, {n: Verdict(n) for n in ("cam0", "cam1")}, Thresholds())
    assert found["cam0"].suspects == found["cam1"].suspects == ("cam0", "cam1")
    assert found["cam0"].sentence() == found["cam1"].sentence()
    assert found["cam0"].sentence().startswith("cam0 or cam1 has moved")


def test_a_span_without_a_rival_determines_the_camera():
    rival, clear = finding(2.0, gain=4.0, rivals=["cam0"]), TURNED
    assert verdicts_on(rival, clear)[-1].suspects == ()


def test_stamps_far_from_the_others():
    found = verdicts_on(GOOD, None, None, lead=[0.0, 12.0, 12.0])
    assert [v.state for v in found] == [State.OK, State.OK, State.STAMPS_OFF]
    assert "the stamps of cam1 are 12.0 s ahead of those of the others" in found[-1].sentence()
