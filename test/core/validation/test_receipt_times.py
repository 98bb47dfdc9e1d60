"""Stamps against the times at which a recorder received the images."""

from __future__ import annotations

import numpy as np
import pytest

from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rejection import RemarkCode
from stcalib_ros.core.validation.receipt_times import receipt_remarks, stamp_jumps

TIMES = np.arange(900) / 30.0


def camera(stamps=TIMES, received=None, *, name="cam0"):
    return LiftedCamera(name, np.asarray(stamps), (), received=received)


def delayed(rng, times=TIMES):
    """Delays of 20 ms and more, bursts of half a second in which messages wait."""
    delay = 0.02 + 0.01 * rng.exponential(size=len(times))
    waiting = (times % 7.0) < 0.5
    return times + np.where(waiting, 0.5 - times % 7.0, 0.0) + delay


def test_a_clock_that_is_set_is_found(rng):
    stamps = TIMES + np.where(TIMES > 15.0, 0.1, 0.0)
    jump = stamp_jumps([camera(received=delayed(rng)), camera(stamps, delayed(rng))])[1]
    assert jump.size_s == pytest.approx(0.1, abs=0.01)
    assert jump.begin_s == pytest.approx(15.0, abs=1.5)
    assert jump.sudden


def test_lost_images_that_are_numbered_evenly_are_found(rng):
    taken = TIMES[rng.random(len(TIMES)) > 0.03]
    jump = stamp_jumps(
        [camera(received=delayed(rng)), camera(TIMES[: len(taken)], delayed(rng, taken))]
    )[1]
    assert jump.size_s > 0.2
    assert not jump.sudden


def test_usual_delays_say_nothing(rng):
    assert stamp_jumps([camera(received=delayed(rng)) for _ in range(20)]) == {}


@pytest.mark.parametrize("received", [None, TIMES, TIMES[:-1], np.full(900, np.nan)])
def test_without_times_of_its_own_nothing_is_said(received):
    """Nobody recorded them, they are the stamps, or do not belong to the images."""
    stamps = TIMES + np.where(TIMES > 15.0, 0.1, 0.0) if received is not TIMES else TIMES
    assert stamp_jumps([camera(stamps, received), camera()]) == {}


def test_the_clock_of_the_recorder_may_be_set(rng):
    jumped = [delayed(rng) + np.where(TIMES > 15.0, 0.1, 0.0) for _ in range(2)]
    assert stamp_jumps([camera(received=one) for one in jumped]) == {}


def test_only_what_is_sudden_is_remarked(rng):
    steady = camera(received=delayed(rng))
    late = camera(received=delayed(rng) + 0.05 * TIMES)
    stamps = TIMES - np.where(TIMES > 20.0, 0.06, 0.0)
    assert receipt_remarks([steady, steady, late]) == ()
    (remark,) = receipt_remarks([steady, steady, camera(stamps, delayed(rng), name="cam2")])
    assert (remark.code, remark.cameras) == (RemarkCode.STAMPS_JUMP, ("cam2",))
    assert remark.values["jump_ms"] == pytest.approx(60.0, abs=8.0)
