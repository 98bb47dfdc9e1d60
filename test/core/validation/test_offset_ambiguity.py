"""Other time offsets that fit as well, within the range that the user allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stcalib_ros.core.validation.offset_ambiguity import offset_peak_ratios


@pytest.fixture(scope="module")
def last(small_stages):
    return small_stages.iterations[-1]


def with_repeated_motion(last, frames):
    """Everybody is seen where they were so many frames before: that offset fits, too."""
    obs, x = last.observations, last.observations.x.copy()
    for person in np.unique(obs.person):
        rows = np.flatnonzero(obs.person == person)
        x[rows[frames:], 1] = obs.x[rows[:-frames], 1]
    return replace(last, observations=replace(obs, x=x))


def test_walking_people_determine_the_offset(last):
    ratio, distance_s = offset_peak_ratios(last, max_shift=15)
    assert ratio.min() > 1.5
    assert (distance_s <= 15 * last.observations.step_s).all()


def test_an_offset_that_fits_better_is_found(last):
    ratio, distance_s = offset_peak_ratios(with_repeated_motion(last, 5), max_shift=15)
    assert ratio[1] < 1.0
    assert distance_s[1] == pytest.approx(5 * last.observations.step_s)


@pytest.mark.parametrize("max_shift", [3, 4, 5, 8, 10])
def test_no_offset_outside_of_the_range_is_tried(last, max_shift):
    repeated = with_repeated_motion(last, 6)
    _, distance_s = offset_peak_ratios(repeated, max_shift=max_shift)
    frames = distance_s / last.observations.step_s
    assert frames.max() < max_shift + 0.5
    assert frames[1] == pytest.approx(min(max_shift, 6))


def test_an_offset_without_alternatives_is_not_ambiguous(last):
    ratio, distance_s = offset_peak_ratios(last, max_shift=2)
    assert np.isposinf(ratio).all()
    assert (distance_s == 0.0).all()


@pytest.mark.parametrize(("offset_frames", "possible"), [(10.0, True), (-10.0, False)])
def test_offsets_beyond_the_range_are_no_alternatives(last, offset_frames, possible):
    """Five frames earlier is where another offset fits, in a range of eight frames."""
    repeated, step_s = with_repeated_motion(last, 5), last.observations.step_s
    offset_s = last.rig.offset_s.copy()
    offset_s[1] = offset_frames * step_s
    moved = replace(repeated, rig=replace(repeated.rig, offset_s=offset_s))
    ratio, _ = offset_peak_ratios(moved, max_shift=18, offset_range_s=8 * step_s)
    assert bool(ratio[1] < 1.0) is possible
