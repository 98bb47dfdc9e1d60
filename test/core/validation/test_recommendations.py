"""Which camera is known least, what would help it, and clock rates that are left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import HALF_SECOND, SMALL, SOUND

from stcalib_ros.core.bundle.iteration import ClockSkews
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.synthetic import simulate
from stcalib_ros.core.validation.recommendations import (
    least_constrained_camera,
    shared_s,
    unobservable_clock_skews,
)

NAMES = ["cam0", "cam1", "cam2"]


@pytest.fixture(scope="module")
def last(small_stages):
    return small_stages.rounds[-1]


def said(last, **changes):
    """Of three cameras, the last one changed."""
    return least_constrained_camera(NAMES, [SOUND, SOUND, replace(SOUND, **changes)], last)


@pytest.mark.parametrize(
    ("changes", "numbers"),
    [
        ({"rotation_stddev": 0.002}, r"rotation to 0.11 degrees"),
        ({"centre_stddev": 0.05}, r"position to 5 % of its distance"),
        ({"offset_stddev_frames": 0.5}, r"clock to 17 ms"),
    ],
)
def test_the_camera_with_the_largest_deviations_is_named_with_them(last, changes, numbers):
    text = said(last, **changes)
    assert text.startswith("least is known of cam2 (")
    assert numbers in text


def test_an_uncertain_clock_wants_faster_people(last):
    assert "people who move faster" in said(last, offset_stddev_frames=0.5)
    assert "people who move faster" not in said(last, rotation_stddev=0.01)


def test_little_in_common_wants_people_where_the_views_overlap(last):
    text = said(last, rotation_stddev=0.01, shared_s=2.0)
    assert "it shares 2.0 s of people's motion with the others, who share 8.0 s" in text
    common = shared_s(last)[2]
    partner = int(np.argmin(common[:2]))
    assert f"let people walk where it and cam{partner} see them ({common[partner]:.1f} s)" in text


def test_else_a_longer_clip_helps(last):
    assert "a clip twice as long" in said(last, rotation_stddev=0.002)


def test_the_advice_of_a_longer_clip_holds():
    """Deviations of a clip of twice the length, against what is promised."""
    short, long = (
        run_stages(simulate(replace(SMALL, n_frames=n, seed=5)).recording, HALF_SECOND)
        for n in (80, 160)
    )
    assert "a clip twice as long would make that about 30 % less" in short.calibration.message
    before, after = (
        np.sqrt([np.trace(c.covariance[3:, 3:]) for c in stages.calibration.cameras[1:]]).max()
        for stages in (short, long)
    )
    assert after == pytest.approx(0.7 * before, rel=0.35)


def test_known_clocks_have_no_deviation(last):
    known = replace(last, rig=replace(last.rig, synchronised=True))
    assert "clock" not in said(known, rotation_stddev=0.01)


def test_shared_time_is_that_of_common_knots(last):
    time = shared_s(last)
    np.testing.assert_allclose(time, time.T)
    # Two people, seen by three cameras for 80 frames.
    assert time.max() <= 2 * 81 / 30
    assert time[0, 1] > 4.0


# Clock rates


def rates(last, ppm, skew=0.0):
    stddev = np.array([0.0, *1e-6 * np.array(ppm)])
    return replace(last, clock_skews=ClockSkews(np.array([0.0, skew, 0.0]), stddev, 0.0))


def test_why_clock_rates_are_left_out_is_said_with_the_number(last):
    length_s = np.ptp(last.observations.knot) * last.observations.step_s
    text = unobservable_clock_skews(rates(last, (40.0, 80.0)))
    assert f"{length_s:.0f} s tell them to 80 ppm, 10 are needed" in text
    assert f"about {length_s * 4:.0f} s would do" in text


def test_rates_that_are_told_or_not_asked_for_are_not_excused(last):
    assert unobservable_clock_skews(rates(last, (5.0, 5.0), skew=2e-6)) != ""
    told = replace(last, clock_skews=ClockSkews(np.full(3, 2e-6), np.full(3, 4e-6), 0.0))
    assert unobservable_clock_skews(told) == ""
    assert unobservable_clock_skews(replace(last, clock_skews=None)) == ""


def test_a_short_clip_says_it_in_its_message(small_stages):
    message = small_stages.calibration.message
    assert "clock rates are left out: 3 s tell them to" in message
    assert "least is known of cam" in message
    worst = max(c.clock_skew_stddev for c in small_stages.calibration.cameras)
    assert f"to {1e6 * worst:.0f} ppm" in message
