"""Cameras by smooth trajectories."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundle_helpers import FOCAL_PX, STEP_S
from core_helpers import SMALL
from scipy.spatial.transform import Rotation

from stcalib_ros.core.bundle.parameters import Cameras, ParameterLayout
from stcalib_ros.core.bundle.residuals import errors_px
from stcalib_ros.core.evaluation.metrics import evaluate
from stcalib_ros.core.geometry import bsplines as splines
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.options import BundleOptions
from stcalib_ros.core.pipeline import calibrate, run_stages
from stcalib_ros.core.refinement import spline_trajectories as spline
from stcalib_ros.core.refinement.spline_solver import Sight, Trajectories, eliminate, solve
from stcalib_ros.core.refinement.spline_trajectories import with_splines
from stcalib_ros.core.synthetic import simulate

K, J, C = 16, 2, 3
MIXED = replace(
    SMALL, n_cameras=4, fps=(30.0, 25.0, 60.0, 30.0), drop_rate=0.1, n_frames=120, n_people=3
)


def scene(rng, *, sigma_px=0.0):
    """Smooth trajectories of two people, seen by three cameras at any moments; and the cameras."""
    R = exp_so3(np.linspace(0, 1.5, C)[:, None] * [0.1, 1.0, 0.0])
    t = np.array([0.0, 0.0, 5.0]) - R @ [0.0, 0.0, 5.0]
    cameras = Cameras(R, t, np.array([0.0, 0.004, -0.006]))
    people = []
    for _ in range(2):
        start = rng.uniform([-1, -1, 4], [1, 1, 6], (J, 3))
        c = start + np.cumsum(rng.normal(0, 0.05, (K, J, 3)), 0)
        sights = []
        for k in range(C):
            position = np.sort(rng.uniform(1.0, K - 5.0, 30))
            X = splines.values(position + cameras.shift[k] / STEP_S, c)
            Y = X @ R[k].T + t[k]
            focal = np.full(X.shape[:2], FOCAL_PX) * (rng.uniform(size=X.shape[:2]) > 0.2)
            x = Y[..., :2] / Y[..., 2:] + sigma_px / FOCAL_PX * rng.normal(size=(*X.shape[:2], 2))
            sights.append(Sight(position, x, focal))
        people.append(Trajectories(tuple(sights), c, np.full(J, 1e-6)))
    return tuple(people), cameras


def moved(cameras, d):
    return ParameterLayout(C).retract(cameras, d)


def residuals(one, cameras, coefficients):
    """All residuals of one person, px, and those of the prior."""
    out = []
    for k, sight in enumerate(one.sights):
        X = splines.values(sight.position + cameras.shift[k] / STEP_S, coefficients)
        Y = X @ cameras.R[k].T + cameras.t[k]
        out.append(((Y[..., :2] / Y[..., 2:] - sight.x) * sight.focal[..., None]).ravel())
    prior = np.sqrt(one.precision)[:, None] * np.diff(coefficients, 2, axis=0)
    return np.concatenate([*out, prior.ravel()])


def test_the_system_is_that_of_all_residuals_with_the_splines_eliminated(rng):
    people, cameras = scene(rng)
    one = people[0]
    n = 7 * C

    def at(v):
        return residuals(one, moved(cameras, v[:n].reshape(C, 7)), one.coefficients + free(v))

    def free(v):
        return v[n:].reshape(K, J, 3)

    size = n + K * J * 3
    A = np.stack([(at(1e-6 * e) - at(-1e-6 * e)) / 2e-6 for e in np.eye(size)], 1)
    H, g = A.T @ A, A.T @ at(np.zeros(size))
    inverse = np.linalg.pinv(H[n:, n:], rcond=1e-14)
    found = eliminate(one, cameras, STEP_S, 1.0).system
    schur = H[:n, :n] - H[:n, n:] @ inverse @ H[n:, :n]
    np.testing.assert_allclose(found.H, schur, rtol=1e-4, atol=1e-4 * np.abs(schur).max())
    np.testing.assert_allclose(found.g, g[:n] - H[:n, n:] @ inverse @ g[n:], atol=1e-2)


def test_exact_images_give_the_cameras(rng):
    people, cameras = scene(rng)
    start = moved(cameras, np.concatenate([np.zeros((1, 7)), rng.normal(0, 2e-3, (C - 1, 7))]))
    start = start.scaled(cameras.length() / start.length())
    shaken = [
        replace(p, coefficients=p.coefficients + rng.normal(0, 5e-3, (K, J, 3))) for p in people
    ]
    found, after = solve(shaken, start, step_s=STEP_S, sigma=0.2)
    assert Rotation.from_matrix(found.R @ cameras.R.swapaxes(1, 2)).magnitude().max() < 1e-5
    np.testing.assert_allclose(found.t, cameras.t, atol=1e-4)
    np.testing.assert_allclose(found.shift, cameras.shift, atol=1e-6)
    middle = slice(3, K - 5)
    for one, true in zip(after, people, strict=True):
        np.testing.assert_allclose(one.coefficients[middle], true.coefficients[middle], atol=1e-2)


def test_errors_are_as_large_as_the_system_says(rng):
    normalised = []
    for _ in range(20):
        people, cameras = scene(rng, sigma_px=1.0)
        found, _ = solve(people, cameras, step_s=STEP_S, sigma=1.0)
        turned = Rotation.from_matrix(found.R @ cameras.R.swapaxes(1, 2)).as_rotvec()
        shifted = (found.shift - cameras.shift)[:, None]
        e = np.concatenate([turned, found.t - cameras.t, shifted], 1).ravel()
        H = sum(eliminate(one, cameras, STEP_S, 1.0).system.H for one in people)
        normalised.append(e @ H @ e / (7 * (C - 1) - 1))
    assert 0.7 < np.mean(normalised) < 1.4


def test_synchronised_clocks_stay(rng):
    people, cameras = scene(rng, sigma_px=1.0)
    found, _ = solve(people, cameras, step_s=STEP_S, sigma=1.0, synchronised=True)
    np.testing.assert_array_equal(found.shift, cameras.shift)
    assert not np.array_equal(found.R, cameras.R)


def test_clocks_that_run_away_are_no_solution(rng):
    people, cameras = scene(rng)
    far = replace(cameras, shift=cameras.shift + 1.3 * STEP_S * np.arange(C) / 2)
    people = [replace(p, coefficients=p.coefficients[::-1].copy()) for p in people]
    assert solve(people, far, step_s=STEP_S, sigma=1e-3) is None


def test_where_every_camera_has_an_image_at_every_knot_nothing_changes(small_stages):
    last = small_stages.iterations[-1]
    assert with_splines(small_stages.lifted, last, BundleOptions()) is last


def test_cameras_of_several_rates_gain():
    ratios = []
    for seed in range(6):
        s = simulate(replace(MIXED, seed=seed))
        with_it = evaluate(calibrate(s.recording), s.truth, fps=30.0)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(spline, "MIN_OCCUPANCY", 0.0)
            without = evaluate(calibrate(s.recording), s.truth, fps=30.0)
        ratios.append(
            [getattr(with_it, n) / getattr(without, n) for n in ("E_R", "E_t", "E_delta")]
        )
    # Four seconds: offsets gain, poses lose nothing.
    assert (np.median(ratios, 0) < [1.1, 1.1, 0.9]).all()


def test_who_is_seen_by_some_cameras_or_by_none_is_no_obstacle():
    s = simulate(replace(MIXED, seed=1))
    stages = run_stages(s.recording)
    last = stages.iterations[-1]
    o, used, track = last.observations, last.state.inlier.copy(), last.observations.track.copy()
    seen = o.observed.copy()
    first, second = (np.flatnonzero(o.person == p) for p in np.unique(o.person)[:2])
    used[first] = False
    for array in (used, seen):
        array[second, 1] = False
    track[second, 1] = -1
    used[second] &= (used[second].sum(1) >= 2)[:, None]
    state = replace(last.state, inlier=used)
    changed = replace(last, observations=replace(o, observed=seen, track=track), state=state)
    found = with_splines(stages.lifted, changed, BundleOptions())
    assert found is not changed
    assert np.isfinite(found.state.X).all()
    np.testing.assert_allclose(found.rig.t_ref_cam, last.rig.t_ref_cam, atol=0.05)


def test_points_that_no_spline_meets_are_outliers():
    """A joint that leaps away for a moment is not followed, and does not count as fitting."""
    s = simulate(replace(MIXED, seed=1))
    stages = run_stages(s.recording)
    last = stages.iterations[-1]
    x = last.observations.x.copy()
    leap = np.flatnonzero(last.state.inlier[:, :, 0].sum(1) >= 2)[20:23]
    x[leap, :, 0] += 0.5
    changed = replace(last, observations=replace(last.observations, x=x))
    found = with_splines(stages.lifted, changed, BundleOptions())
    assert found is not changed
    assert not found.state.inlier[leap, :, 0].any()
    errors = errors_px(found.observations, found.state)[found.state.inlier]
    assert errors.max() < 4 * BundleOptions().outlier_factor * np.median(errors)


def test_motion_that_splines_do_not_hold_is_left_to_free_points(monkeypatch):
    s = simulate(replace(MIXED, seed=1))
    monkeypatch.setattr(spline, "MIN_OCCUPANCY", 0.0)
    plain = calibrate(s.recording)
    monkeypatch.undo()
    monkeypatch.setattr(spline, "_SPACING_S", 0.6)
    found = calibrate(s.recording)
    for one, other in zip(found.cameras, plain.cameras, strict=True):
        np.testing.assert_array_equal(one.R_ref_cam, other.R_ref_cam)
