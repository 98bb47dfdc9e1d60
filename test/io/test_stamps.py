"""Stamps in serialised messages, and their correction to the reference clock."""

from __future__ import annotations

import struct
from contextlib import suppress
from fractions import Fraction

import hypothesis.strategies as st
import pytest
from hypothesis import given

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.messages import NS
from stcalib_ros.io.stamps import ClockCorrection, Restamper, changes, stamp_of, with_stamp

T0 = 1_760_000_000 * NS
LITTLE, BIG = b"\x00\x01\x00\x00", b"\x00\x00\x00\x00"
STAMPS = st.integers(1, 2**31 * NS - 1)


def message(stamp_ns: int, *, body: bytes = b"body", big: bool = False) -> bytes:
    stamp = struct.pack(">iI" if big else "<iI", *divmod(stamp_ns, NS))
    return (BIG if big else LITTLE) + stamp + body


def relayed(restamper: Restamper, stamps: list[int]) -> list[int | None]:
    sent = [restamper(message(stamp)) for stamp in stamps]
    return [None if data is None else stamp_of(data) for data in sent]


def corrected(offset_s: float) -> Restamper:
    restamper = Restamper()
    restamper.correction = ClockCorrection(offset_s)
    return restamper


@given(STAMPS, STAMPS, st.binary(max_size=20), st.booleans())
def test_only_the_stamp_is_replaced(before, after, body, big):
    data = message(before, body=body, big=big)
    assert stamp_of(data) == before
    assert with_stamp(data, after) == message(after, body=body, big=big)


@given(
    STAMPS,
    st.floats(-60.0, 60.0),
    st.floats(-1e-3, 1e-3),
    st.integers(-3600 * NS, 3600 * NS),
)
def test_corrections_are_exact_to_a_nanosecond(stamp, offset_s, skew, age):
    epoch = stamp - age
    exact = stamp + Fraction(offset_s) * NS + Fraction(skew) * age
    assert abs(ClockCorrection(offset_s, skew, epoch).apply(stamp) - exact) <= 1


@pytest.mark.parametrize(
    ("offset_s", "skew"),
    [(float("nan"), 0.0), (float("inf"), 0.0), (1e300, 0.0), (-1e10, 0.0), (0.0, 1.0), (0.0, -1.5)],
)
def test_clocks_that_are_none_are_refused(offset_s, skew):
    with pytest.raises(InputError, match="no clock"):
        ClockCorrection(offset_s, skew)


@given(STAMPS, st.floats(), st.floats(), st.integers(-(2**31) * NS, 2**31 * NS))
def test_whatever_a_result_says_a_message_is_relayed_or_dropped(stamp, offset_s, skew, epoch_ns):
    restamper = Restamper()
    with suppress(InputError):
        restamper.correction = ClockCorrection(offset_s, skew, epoch_ns)
    out = restamper(message(stamp))
    assert (restamper.relayed, restamper.dropped) == ((0, 1) if out is None else (1, 0))


@pytest.mark.parametrize("data", [b"", LITTLE, message(T0)[:11], b"\x00\x03\x00\x00" + bytes(20)])
def test_other_bytes_are_dropped_and_the_reason_is_kept(data):
    restamper = corrected(0.0)
    assert restamper(data) is None
    assert (restamper.relayed, restamper.dropped) == (0, 1)
    assert "are not a message in plain CDR with a header" in restamper.problem


def test_before_the_offset_is_known_messages_are_dropped():
    restamper = Restamper()
    assert restamper(message(T0)) is None
    assert (restamper.dropped, restamper.problem) == (1, "the offset of its camera is not known")


def test_no_stamp_is_no_stamp_afterwards():
    assert corrected(0.3)(message(0)) == message(0)


@pytest.mark.parametrize(("stamp", "offset_s"), [(NS, -1.5), (2**31 * NS - 1, 0.5)])
def test_a_time_that_no_stamp_can_hold_is_dropped(stamp, offset_s):
    restamper = corrected(offset_s)
    assert restamper(message(stamp)) is None
    assert "no stamp can hold" in restamper.problem


def test_stamps_go_on_after_an_offset_has_become_smaller():
    """By 0.1 s: two images of that time are dropped, the third is later again."""
    restamper = corrected(0.3)
    step = NS // 30
    assert relayed(restamper, [T0]) == [T0 + 3 * NS // 10]
    restamper.correction = ClockCorrection(0.2)
    stamps = [T0 + k * step for k in range(1, 5)]
    assert relayed(restamper, stamps) == [None, None, None, stamps[3] + NS // 5]
    assert "would go back by 0.000 s" in restamper.problem
    assert restamper.dropped == 3


@given(st.lists(st.tuples(st.integers(0, 10 * NS), st.floats(-2.0, 2.0)), min_size=2, max_size=20))
def test_what_goes_out_goes_back_only_if_what_comes_in_does(arrivals):
    """Whatever the offsets do meanwhile."""
    restamper, last_in, last_out, back = Restamper(), 0, 0, False
    for after, offset_s in arrivals:
        restamper.correction = ClockCorrection(offset_s)
        stamp = T0 + after
        back = back or stamp < last_in
        (out,) = relayed(restamper, [stamp])
        last_in = stamp
        if out is not None:
            assert out >= last_out or back
            last_out, back = out, False


def test_a_jump_back_is_passed_on():
    restamper = corrected(0.3)
    stamps = [T0, T0 + NS, T0, T0 + NS]
    assert relayed(restamper, stamps) == [t + 3 * NS // 10 for t in stamps]


def test_what_holds_until_the_next_is_sent_again():
    restamper = corrected(0.3)
    relayed(restamper, [T0])
    restamper.correction = ClockCorrection(0.1)
    assert restamper.again(message(T0)) == message(T0 + NS // 10)


def test_changes_are_told():
    before = {"a": ClockCorrection(0.1), "b": ClockCorrection(0.2), "c": ClockCorrection(0.3)}
    after = {"a": ClockCorrection(0.1), "b": ClockCorrection(-0.2, 1e-6), "d": ClockCorrection(0.0)}
    assert changes(before, after) == {
        "b": "-200.000 ms, +1.00 ppm",
        "d": "+0.000 ms",
        "c": "no longer known",
    }
