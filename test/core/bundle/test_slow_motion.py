"""Offsets of people who hardly move: drawn by noise in the velocities, and put back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundle_helpers import STEP_S, problem

from stcalib_ros.core.bundle.levenberg_marquardt import adjust
from stcalib_ros.core.bundle.offset_debiasing import (
    debias_offsets,
    offset_bias_s,
    velocity_noise_fraction,
    with_smoothed_velocities,
)
from stcalib_ros.core.bundle.state import estimate_motion

MOST_OF_A_FRAME = 0.8 * STEP_S
SLOW = {"pace_m_s": 0.2, "acceleration": 0.02}


def adjusted(rng, **motion):
    """A problem with clocks off by most of a frame, and what the usual adjustment makes of it."""
    size = {"time_bins": 60, "joints": 10, "phi_frames": 0.0}
    p = problem(rng, sigma_px=3.0, offset_s=MOST_OF_A_FRAME, **size, **motion)
    start = replace(p.truth, shift_s=np.zeros(3))
    V, A = estimate_motion(p.o, p.truth.X, p.o.observed.any(1))
    start = replace(start, V=V, A=A)
    state = adjust(p.o, start, iterations=30, tolerance=0.01, renew_velocities=True)
    return p, state


def error_frames(p, state):
    return np.abs(state.shift_s - p.truth.shift_s)[1:] / STEP_S


def test_offsets_of_slow_people_are_put_back(rng):
    p, state = adjusted(rng, **SLOW)
    before = error_frames(p, state).max()
    assert before > 0.1
    after = debias_offsets(p.o, state, iterations=30)
    assert error_frames(p, after).max() < 0.6 * before


def test_the_first_step_points_to_the_true_offset(rng):
    p, state = adjusted(rng, **SLOW)
    worst = 1 + int(error_frames(p, state).argmax())
    towards = p.truth.shift_s[worst] - state.shift_s[worst]
    assert np.sign(offset_bias_s(p.o, with_smoothed_velocities(p.o, state))[worst]) == np.sign(
        towards
    )


def test_offsets_of_fast_people_stay_as_they_are(rng):
    p, state = adjusted(rng)
    assert debias_offsets(p.o, state, iterations=30) is state


def test_the_share_of_noise_is_about_that_of_the_velocities(rng):
    _, fast = adjusted(rng)
    p, slow = adjusted(rng, **SLOW)
    assert velocity_noise_fraction(fast, with_smoothed_velocities(p.o, fast)) < 0.1
    share = velocity_noise_fraction(slow, with_smoothed_velocities(p.o, slow))
    error, true = slow.V - p.truth.V, p.truth.V
    true_share = (error**2).sum() / (true**2).sum()
    assert 0.3 * true_share < share <= true_share


def test_known_clocks_are_left_alone(rng):
    p, state = adjusted(rng, **SLOW)
    known = replace(state, synchronised=True)
    assert debias_offsets(p.o, known, iterations=30) is known


def test_calmer_velocities_are_nearer_to_those_of_slow_people(rng):
    p, state = adjusted(rng, **SLOW)
    before, after = (
        np.abs(one.V - p.truth.V).mean() for one in (state, with_smoothed_velocities(p.o, state))
    )
    assert after < 0.5 * before


@pytest.mark.parametrize("step_s", [1 / 60, 1 / 25])
def test_half_a_second_whatever_the_frame_rate(rng, step_s):
    """A path of the third degree in time is read exactly, at any rate and over any window."""
    p = problem(rng, time_bins=80)
    o = replace(p.o, step_s=step_s)
    when = (o.time_bin * step_s)[:, None, None]
    state = replace(p.truth, X=np.ones((1, 3, 3)) * when**3, inlier=np.ones_like(o.observed))
    inside = (o.time_bin > 20) & (o.time_bin < 60)
    found = with_smoothed_velocities(o, state).V[inside]
    np.testing.assert_allclose(found, (3 * np.ones((1, 3, 3)) * when**2)[inside], rtol=1e-6)
