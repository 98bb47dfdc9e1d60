"""The figures of the node's load; without ROS."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stcalib_ros.ros.limits import LOAD_SPAN_S, MAX_PUBLISHERS
from stcalib_ros.ros.load import LossCounter, Meter


class Clock:
    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


def test_quantiles_are_those_of_the_last_minute():
    clock = Clock()
    meter = Meter(clock)
    meter.waited(100.0)
    meter.held(100.0)
    meter.load()
    rng = np.random.default_rng(0)
    for _ in range(60):
        clock.now_s += LOAD_SPAN_S / 60
        for value in rng.permutation(101):
            meter.waited(value * 1e-3)
            meter.held(value * 1e-4)
        load = meter.load()
    assert load.messages == 60 * 101
    assert (load.delay_p50_s, load.delay_p99_s, load.delay_max_s) == pytest.approx(
        (0.05, 0.099, 0.1)
    )
    assert (load.hold_p99_s, load.hold_max_s) == pytest.approx((0.0099, 0.01))


def test_nothing_has_no_made_up_numbers():
    load = Meter().load()
    assert load.messages == 0
    assert math.isnan(load.delay_p99_s)
    assert math.isnan(load.hold_max_s)


def test_a_clock_that_was_set_back_gives_no_negative_delay():
    meter = Meter()
    meter.waited(-5.0)
    assert meter.load().delay_max_s == 0.0


def test_a_callback_is_timed_and_called():
    meter, called = Meter(), []
    meter.timed(lambda: called.append(1))()
    assert called == [1]
    assert meter.load().hold_max_s >= 0.0


@pytest.mark.parametrize(
    ("numbers", "lost"),
    [
        ([], 0),
        ([5], 0),
        ([1, 2, 3], 0),
        ([1, 4, 5, 7], 3),
        ([8, 9, 1, 2], 0),
        ([1, 10**9, 10**9 + 2], 1),
        ([None, None], 0),
        ([100, 101, 5, 102, 6, 103, 7], 0),
        ([100, 600, 101, 601, 102, 602], 0),
        ([100, 5, 101, 8, 105, 9, 106], 5),
        ([5, 5, 6, 6, 7, 7], 0),
        ([100, 103, 101, 104, 102, 105], 0),
        ([1000, 1001, 1, 2, 1004, 3], 2),
    ],
    ids=[
        "none",
        "first",
        "all",
        "gaps",
        "restart",
        "another publisher",
        "not told",
        "a second publisher behind",
        "a second publisher ahead",
        "both lose",
        "the same numbers",
        "close numbers",
        "one loses beside another",
    ],
)
def test_losses_are_gaps_in_the_numbers(numbers, lost):
    counter = LossCounter()
    for number in numbers:
        counter.came(number)
    assert counter.lost == lost


def test_two_publishers_of_other_rates_pass_each_other():
    """One at 30 Hz catches up with one at 15 Hz; each loses a tenth of its messages."""
    rng = np.random.default_rng(0)
    fast, slow = np.arange(1, 601), np.arange(150, 450)
    kept_fast, kept_slow = (numbers[rng.random(len(numbers)) > 0.1] for numbers in (fast, slow))
    sent = sorted([(n / 30, n) for n in kept_fast] + [((n - 150) / 15, n) for n in kept_slow])
    counter = LossCounter()
    for _, number in sent:
        counter.came(int(number))
    true = len(fast) + len(slow) - len(sent)
    assert counter.lost == pytest.approx(true, rel=0.25)


def test_any_numbers_at_all_are_bounded_in_memory():
    counter = LossCounter()
    rng = np.random.default_rng(0)
    for number in rng.integers(0, 2**63, 2000):
        counter.came(int(number))
    assert counter.lost >= 0
    assert len(counter._publishers) <= MAX_PUBLISHERS
