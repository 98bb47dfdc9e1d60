"""Offsets without what noise in the velocities does to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundle_helpers import STEP_S, problem

from stcalib_ros.core.bundle.covariance import pose_covariance
from stcalib_ros.core.bundle.lens_unknowns import corrections
from stcalib_ros.core.bundle.lenses import estimated_lenses
from stcalib_ros.core.bundle.levenberg_marquardt import PointProblem, adjust
from stcalib_ros.core.bundle.offset_debiasing import debiased, velocity_noise
from stcalib_ros.core.bundle.residuals import at_images
from stcalib_ros.core.bundle.state import estimate_motion
from stcalib_ros.core.geometry.robust import CAUCHY
from stcalib_ros.core.model.lens_knowledge import LensPrior
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import Intrinsics, LensModel

PHASES = np.array([0.0, 0.4, -0.4]) * STEP_S
SCALE = 2.0 * CAUCHY


def steady_phases(p):
    """The same motion seen at the same phase of every frame, without noise; offsets are right."""
    phi = np.tile(PHASES, (len(p.o.person), 1))
    truth = replace(p.truth, shift_s=np.zeros(3))
    o = replace(p.o, phi=phi)
    Y = at_images(o, truth) @ np.swapaxes(truth.R_cam_ref, 1, 2) + truth.t_cam_ref[:, None]
    return replace(o, x=np.where(o.observed[..., None], Y[..., :2] / Y[..., 2:], 0)), truth


def noisy(o, seed, sigma_px=2.0):
    noise = sigma_px * np.random.default_rng(seed).normal(size=o.x.shape) / o.focal[..., None]
    return replace(o, x=np.where(o.observed[..., None], o.x + noise, 0))


@pytest.fixture(scope="module")
def exact():
    return steady_phases(
        problem(np.random.default_rng(0), people=8, time_bins=24, joints=6, sigma_px=0)
    )


@pytest.fixture(scope="module")
def repeated(exact):
    """Offset errors (n, 2) before and after, by their predicted deviations."""
    errors = []
    for seed in range(12):
        o = noisy(exact[0], seed)
        state = adjust(o, exact[1], iterations=30, tolerance=1e-3, renew_velocities=True)
        after = debiased(o, state)
        deviation = np.sqrt(np.diag(pose_covariance(o, after))[13::7])
        errors.append([one.shift_s[1:] / deviation for one in (state, after)])
    return np.array(errors)


def test_offsets_are_no_longer_drawn_towards_whole_frames(repeated):
    towards = -np.sign(PHASES[1:])
    before, after = (repeated * towards).mean((0, 2))
    # Means of 24 standard normals, less than independent.
    assert before > 0.7
    assert abs(after) < 0.5
    assert (repeated[:, 1] ** 2).mean() < 2.5


def test_one_sample_says_how_large_the_noise_is(exact):
    o, truth = exact
    noise = velocity_noise(o, truth, SCALE)
    np.testing.assert_allclose(noise.H, noise.H.T)
    found = []
    for seed in range(6):
        state = adjust(noisy(o, seed), truth, iterations=5, tolerance=1e-3)
        V = estimate_motion(o, state.X - truth.X, noise.present)[0].reshape(-1, 3)
        found.append(0.0)
        for block, at in PointProblem(o, truth, SCALE).linearised():
            h, y, _ = at.by_time(SCALE, V[block.points].T)
            found[-1] = found[-1] + h.sum(1) - (y**2).sum((0, 2))
    # Weights of exact image points are one, those of noisy ones that moved the joints less.
    np.testing.assert_allclose(np.diag(noise.H), np.mean(found, 0), rtol=0.3)


def test_the_order_of_persons_does_not_matter(exact):
    o, truth = exact
    n = len(o.person) // 2
    rows = np.r_[n : 2 * n, :n]
    other, state = o.only(rows), truth.only(rows)
    other = replace(other, person=(other.person + 4) % 8)
    one = velocity_noise(o, truth, SCALE)
    two = velocity_noise(other, state, SCALE)
    np.testing.assert_allclose(two.H, one.H, rtol=1e-9)
    np.testing.assert_allclose(two.g, one.g, rtol=1e-9, atol=1e-9 * np.abs(one.g).max())


def test_who_stands_still_is_left_alone():
    o, truth = steady_phases(problem(np.random.default_rng(1), time_bins=20, sigma_px=0))
    X = truth.X[o.time_bin == 5][o.person]
    still = replace(truth, X=X, V=0 * X, A=0 * X)
    Y = X[:, None] @ np.swapaxes(still.R_cam_ref, 1, 2) + still.t_cam_ref[:, None]
    seen = replace(o, x=np.where(o.observed[..., None], Y[..., :2] / Y[..., 2:], 0))
    state = adjust(noisy(seen, 0), still, iterations=5, tolerance=0.1)
    assert debiased(noisy(seen, 0), state) is state


def test_nothing_changes_without_noise_or_with_one_clock(exact):
    o, truth = exact
    assert debiased(o, truth) is truth
    synchronised = replace(truth, synchronised=True)
    assert debiased(noisy(o, 0), synchronised) is synchronised


def test_a_joint_in_line_with_its_cameras_is_not_well_placed(exact):
    o, truth = exact
    centres = -np.einsum("cji,cj->ci", truth.R_cam_ref, truth.t_cam_ref)
    X = truth.X.copy()
    X[3, 2] = centres[1] + 3.0 * (centres[1] - centres[0])
    used = truth.inlier.copy()
    used[3, :, 2] = [True, True, False]
    placed = velocity_noise(o, replace(truth, X=X, inlier=used), SCALE).present
    assert not placed[3, 2]
    assert placed.mean() > 0.9


def test_a_lens_that_noise_would_move_by_more_than_is_known_of_it_stays(exact, monkeypatch):
    K = np.diag([1400.0, 1400.0, 1.0])
    lens = Intrinsics(1920, 1080, LensModel.PLUMB_BOB, K, np.zeros(5))
    prior = LensPrior(1400.0, np.inf, (0.0, 0.0), 10.0, (0.0,), 0.2)
    camera = LiftedCamera("a", np.zeros(1), (), intrinsics=lens, lens_prior=prior)
    lenses = estimated_lenses([camera] * 3)
    o = replace(noisy(exact[0], 0), lenses=lenses)
    start = replace(exact[1], lenses=lenses)
    state = adjust(o, start, iterations=30, tolerance=1e-3, renew_velocities=True)
    limit = "stcalib_ros.core.bundle.offset_debiasing._MAX_LENS_DEVIATIONS"
    monkeypatch.setattr(limit, np.inf)
    free = debiased(o, state)
    assert np.abs(corrections(free.cameras) - corrections(state.cameras)).max() > 1e-6
    monkeypatch.setattr(limit, 0.0)
    held = debiased(o, state)
    np.testing.assert_array_equal(corrections(held.cameras), corrections(state.cameras))
    assert np.abs(held.shift_s - state.shift_s).max() > 0.0
