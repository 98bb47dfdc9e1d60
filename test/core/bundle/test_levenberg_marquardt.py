"""Bundle adjustment against dense linear algebra, finite differences and SciPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundle_helpers import CAUCHY, STEP_S, disturbed, problem, residuals, stepped
from scipy.optimize import least_squares

from stcalib_ros.core.bundle import observations as blocks
from stcalib_ros.core.bundle.levenberg_marquardt import (
    PointProblem,
    adjust,
    cluster_scores,
    time_sums,
)
from stcalib_ros.core.bundle.offset_debiasing import velocity_noise
from stcalib_ros.core.bundle.residuals import errors_px, residuals_px, robust_scale
from stcalib_ros.core.bundle.state import estimate_motion, initial_state
from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.model.rig import Rig


def robust(r, scale):
    """Residuals whose squares add up to the Cauchy cost of points, px^2."""
    square = (r**2).sum(-1, keepdims=True) / scale**2
    return (r * np.sqrt(np.log1p(square) / np.maximum(square, 1e-300))).ravel()


def jacobian(function, n, h=1e-6):
    """Central differences of a vector function at zero."""
    columns = [(function(h * e) - function(-h * e)) / (2 * h) for e in np.eye(n)]
    return np.stack(columns, -1)


def scale_of(p, state):
    return CAUCHY * max(robust_scale(errors_px(p.o, state), state.inlier), 0.5)


def start_of(p, rng, size=0.01):
    return disturbed(rng, p.truth, size)


# Residuals


def test_residuals_are_those_written_out_point_by_point(rng):
    p = problem(rng)
    state = start_of(p, rng)
    r, used = residuals_px(p.o, state)
    np.testing.assert_array_equal(used, state.inlier)
    np.testing.assert_allclose(r[used], residuals(p, state), rtol=1e-9, atol=1e-9)


def test_without_noise_the_truth_has_no_residual(rng):
    p = problem(rng, sigma_px=0)
    np.testing.assert_allclose(residuals_px(p.o, p.truth)[0][p.o.observed], 0, atol=1e-9)


def test_errors_of_what_was_not_seen_are_unknown(rng):
    p = problem(rng, missing=0.5)
    errors = errors_px(p.o, p.truth)
    np.testing.assert_array_equal(np.isfinite(errors), p.o.observed)


def test_a_point_behind_a_camera_takes_no_part(rng):
    p = problem(rng, missing=0)
    X = p.truth.X.copy()
    X[3, 1] = -X[3, 1]
    _, used = residuals_px(p.o, replace(p.truth, X=X))
    assert not used[3, 0, 1]
    assert used[3, 0, 0]


def test_the_robust_scale_is_the_deviation_of_gaussian_noise(rng):
    errors = np.linalg.norm(2.5 * rng.normal(size=(200, 3, 20, 2)), axis=-1)
    errors[rng.uniform(size=errors.shape) < 0.05] *= 100
    used = np.ones(errors.shape, dtype=bool)
    # Three views of a point leave half of the noise in the residuals of an adjustment.
    assert robust_scale(errors, used) == pytest.approx(2.5 * 1.05 / np.sqrt(0.5), rel=0.03)
    assert np.isnan(robust_scale(errors, ~used))


# The reduced system


def every_point(p):
    """Each point a cluster of its own."""
    return np.arange(p.truth.X[..., 0].size).reshape(p.truth.X.shape[:2])


def dense_normal_equations(p, state, scale):
    """H, g of all unknowns, cameras first, from finite differences."""
    C, (N, J) = len(state.t_cam_ref), state.X.shape[:2]
    n_camera = 7 * C

    def r(v):
        d_point = v[n_camera:].reshape(N, J, 3)
        return residuals(p, stepped(state, v[:n_camera].reshape(C, 7), d_point))

    here = r(np.zeros(n_camera + N * J * 3))
    A = jacobian(lambda v: r(v).ravel(), n_camera + N * J * 3)
    weight = np.repeat(1 / (1 + (here**2).sum(-1) / scale**2), 2)
    return A.T @ (weight[:, None] * A), A.T @ (weight * here.ravel()), n_camera


def test_the_reduced_system_is_the_schur_complement_of_the_dense_one(rng):
    p = problem(rng, people=1, time_bins=4, joints=2, missing=0.1)
    state = start_of(p, rng)
    system, _ = cluster_scores(p.o, state, every_point(p))
    H, g, n = dense_normal_equations(p, state, scale_of(p, state))
    points = np.flatnonzero(np.diag(H)[n:] > 0) + n
    eliminate = H[:n, points] @ np.linalg.inv(H[np.ix_(points, points)])
    H_expected = H[:n, :n] - eliminate @ H[points, :n]
    expected_g = g[:n] - eliminate @ g[points]
    size = np.sqrt(np.outer(np.diag(H)[:n], np.diag(H)[:n]))
    np.testing.assert_allclose(system.H / size, H_expected / size, atol=1e-6)
    root = np.sqrt(np.diag(H)[:n])
    np.testing.assert_allclose(system.g / root, expected_g / root, atol=1e-3)


def test_the_clusters_add_up_to_the_gradient(rng):
    p = problem(rng, people=2, time_bins=5, joints=3)
    state = start_of(p, rng)
    system, scores = cluster_scores(p.o, state, every_point(p))
    np.testing.assert_allclose(scores.sum(1), system.g, rtol=1e-9)
    np.testing.assert_array_equal(scores.any(0), (p.o.observed.sum(1) >= 2).ravel())
    coarse = every_point(p) % 4
    np.testing.assert_allclose(
        cluster_scores(p.o, state, coarse)[1],
        np.stack([scores[:, k::4].sum(1) for k in range(4)], 1),
        rtol=1e-9,
        atol=1e-9 * np.abs(scores).max(),
    )


def test_the_division_into_blocks_does_not_matter(rng, monkeypatch):
    p = problem(rng, people=2, time_bins=12)
    state = start_of(p, rng)
    whole = cluster_scores(p.o, state, every_point(p))
    end = adjust(p.o, state, iterations=10, tolerance=1e-6)
    monkeypatch.setattr(blocks, "_BLOCK", 1)
    parts = cluster_scores(p.o, state, every_point(p))
    np.testing.assert_allclose(parts[0].H, whole[0].H, atol=1e-9 * np.abs(whole[0].H).max())
    np.testing.assert_allclose(parts[1], whole[1], atol=1e-9 * np.abs(whole[1]).max())
    again = adjust(p.o, state, iterations=10, tolerance=1e-6)
    np.testing.assert_allclose(again.X, end.X, atol=1e-8)


def test_the_gradient_is_that_of_the_robust_cost_where_points_are_optimal(rng):
    p = problem(rng, people=1, time_bins=6, joints=2, missing=0)
    state = start_of(p, rng, 0.003)
    scale, C = scale_of(p, state), len(state.t_cam_ref)

    def best_points(cameras, X):
        def cost(v):
            return robust(residuals(p, replace(cameras, X=v.reshape(X.shape))), scale)

        return least_squares(cost, X.ravel(), xtol=1e-15, ftol=1e-15, gtol=1e-13).x.reshape(X.shape)

    state = replace(state, X=best_points(state, state.X))
    problem_ = PointProblem(p.o, state, scale)
    g = problem_.reduce(0.0).system.g

    def cost(v):
        return 0.5 * np.array(
            [(robust(residuals(p, stepped(state, v.reshape(C, 7), 0)), scale) ** 2).sum()]
        )

    numeric = jacobian(cost, 7 * C, 1e-7)[0]
    np.testing.assert_allclose(g, numeric, rtol=1e-3, atol=2e-4 * np.abs(numeric).max())


def test_points_of_which_nothing_is_used_change_no_sums(rng, monkeypatch):
    p = problem(rng, people=2, missing=0)
    used = p.truth.inlier & (p.o.person == 1)[:, None, None]
    state = replace(p.truth, inlier=used)
    monkeypatch.setattr(blocks, "_BLOCK", 1)
    group = np.zeros(len(p.o.person), dtype=int)
    rows = p.o.person == 1
    alone, its = p.o.only(rows), state.only(rows)
    for found, true in zip(
        time_sums(p.o, state, group),
        time_sums(alone, its, group[rows]),
        strict=True,
    ):
        np.testing.assert_allclose(found, true)
    assert velocity_noise(p.o, state, 3.0).present[rows].any()


def test_the_step_solves_the_system_with_reference_and_spread_fixed(rng):
    p = problem(rng)
    state = start_of(p, rng)
    system, _ = cluster_scores(p.o, state, every_point(p))
    d = state.layout.solve(system.H, system.g, state.cameras)
    assert not d[0].any()
    scale, free = state.layout.scale_direction(state.cameras), state.layout.free()
    assert abs(d.ravel() @ scale) < 1e-9 * np.linalg.norm(d)
    left = (system.H @ d.ravel() - system.g)[free]
    left -= left @ scale[free] * scale[free]
    assert np.abs(left).max() < 1e-4 * np.abs(system.g).max()


# The optimum


def scipy_optimum(p, start, scale):
    """SciPy's dense optimum with the reference and the spread of the cameras fixed."""
    C, shape = len(start.t_cam_ref), start.X.shape
    moved, k = start.inlier.any(1), 7 * C - 7

    def unpack(v):
        camera, point = np.zeros((C, 7)), np.zeros(shape)
        camera[1:], point[moved] = v[:k].reshape(-1, 7), v[k:].reshape(-1, 3)
        return stepped(start, camera, point)

    def errors(v):
        state = unpack(v)
        stretched = state.cameras.length() - start.cameras.length()
        return np.append(robust(residuals(p, state), scale), 1e7 * stretched)

    n = k + 3 * int(moved.sum())
    x_scale = np.ones(n)
    x_scale[6:k:7] = STEP_S
    found = least_squares(errors, np.zeros(n), x_scale=x_scale, xtol=1e-12, ftol=1e-14, gtol=1e-12)
    return unpack(found.x)


def test_the_optimum_is_that_of_scipy(rng):
    p = problem(rng, people=1, time_bins=8, joints=3)
    x = p.o.x.copy()
    x[2, 1, 0] += 0.05  # 70 px: an outlier
    p = replace(p, o=replace(p.o, x=x))
    start = start_of(p, rng)
    ours = adjust(p.o, start, iterations=200, tolerance=1e-8)
    scipys = scipy_optimum(p, start, scale_of(p, start))
    relative = np.swapaxes(ours.R_cam_ref, 1, 2) @ scipys.R_cam_ref
    assert rotation_angle(relative).max() < 1e-5
    np.testing.assert_allclose(ours.t_cam_ref, scipys.t_cam_ref, atol=2e-5)
    np.testing.assert_allclose(ours.shift_s, scipys.shift_s, atol=5e-6)
    used = start.inlier.any(1)
    np.testing.assert_allclose(ours.X[used], scipys.X[used], atol=1e-4)


@pytest.mark.parametrize("seed", range(5))
def test_reference_and_spread_stay(seed):
    rng = np.random.default_rng(seed)
    p = problem(rng, cameras=4)
    start = start_of(p, rng, 0.03)
    end = adjust(p.o, start, iterations=20, tolerance=1e-3)
    np.testing.assert_array_equal(end.R_cam_ref[0], start.R_cam_ref[0])
    np.testing.assert_array_equal(end.t_cam_ref[0], start.t_cam_ref[0])
    assert end.shift_s[0] == 0
    assert end.cameras.length() == pytest.approx(start.cameras.length(), rel=1e-12)


@pytest.mark.parametrize("cameras", [2, 3, 5])
def test_without_noise_poses_and_offsets_are_exact(rng, cameras):
    p = problem(rng, cameras=cameras, time_bins=12, sigma_px=0, missing=0.1)
    end = adjust(p.o, start_of(p, rng, 0.02), iterations=300, tolerance=1e-9)
    # The given velocities lose 1e-4 of their size as the cameras are scaled to their spread.
    np.testing.assert_allclose(end.R_cam_ref, p.truth.R_cam_ref, atol=2e-5)
    np.testing.assert_allclose(end.t_cam_ref, p.truth.t_cam_ref, atol=1e-4)
    np.testing.assert_allclose(end.shift_s, p.truth.shift_s, atol=5e-6)
    errors = errors_px(p.o, end)
    assert np.nanmax(errors) < 1e-2


def cost(p, state, scale):
    return (robust(residuals_px(p.o, state)[0][state.inlier], scale) ** 2).sum()


def test_an_adjustment_never_makes_it_worse(rng):
    p = problem(rng, sigma_px=5.0)
    start = start_of(p, rng, 0.1)
    scale, before = scale_of(p, start), np.inf
    for iterations in (0, 1, 2, 5, 20):
        after = cost(p, adjust(p.o, start, iterations=iterations, tolerance=0.0), scale)
        assert after <= before * (1 + 1e-12)
        before = after
    assert before < 0.1 * cost(p, start, scale)


def test_the_world_may_be_turned_and_enlarged(rng):
    p = problem(rng, people=1)
    start = start_of(p, rng)
    factor = 3.0
    lengths = ("t_cam_ref", "X", "V", "A")
    larger = replace(start, **{name: factor * getattr(start, name) for name in lengths})
    ends = [adjust(p.o, s, iterations=50, tolerance=1e-7) for s in (start, larger)]
    np.testing.assert_allclose(ends[1].R_cam_ref, ends[0].R_cam_ref, atol=1e-7)
    np.testing.assert_allclose(ends[1].t_cam_ref, factor * ends[0].t_cam_ref, atol=1e-6)
    np.testing.assert_allclose(ends[1].shift_s, ends[0].shift_s, atol=1e-8)


# The start


def rig_of(state):
    R_ref_cam = np.swapaxes(state.R_cam_ref, 1, 2)
    t_ref_cam = -np.einsum("cij,cj->ci", R_ref_cam, state.t_cam_ref)
    return Rig(np.arange(len(R_ref_cam)), R_ref_cam, t_ref_cam, np.zeros(len(R_ref_cam)), 1.0)


def test_the_start_triangulates_what_two_cameras_see(rng):
    p = problem(rng, sigma_px=0, offset_s=0, time_bins=20, missing=0.3)
    state = initial_state(p.o, rig_of(p.truth))
    used = state.inlier.any(1)
    np.testing.assert_array_equal(used, p.o.observed.sum(1) >= 2)
    # Images lie up to half a step from their time bin: the motion in between is allowed for.
    away = np.linalg.norm(state.X - p.truth.X, axis=-1)[used]
    assert np.median(away) < 5e-3
    faster = np.linalg.norm(state.V - p.truth.V, axis=-1)[used]
    assert np.median(faster) < 0.1


def test_without_motion_the_start_is_exact(rng):
    p = problem(rng, sigma_px=0, offset_s=0)
    still = replace(p.o, phi=np.zeros_like(p.o.phi))
    X = p.truth.X
    Y = np.einsum("cij,npj->ncpi", p.truth.R_cam_ref, X) + p.truth.t_cam_ref[:, None]
    still = replace(still, x=np.where(p.o.observed[..., None], Y[..., :2] / Y[..., 2:], 0))
    state = initial_state(still, rig_of(p.truth))
    used = state.inlier.any(1)
    np.testing.assert_allclose(state.X[used], X[used], atol=1e-8)


def test_motion_is_per_second_and_by_person(rng):
    p = problem(rng, people=3, time_bins=10)
    V, A = estimate_motion(p.o, p.truth.X, np.ones(p.truth.X.shape[:2], dtype=bool))
    np.testing.assert_allclose(V, p.truth.V, atol=1e-2)
    np.testing.assert_allclose(A, p.truth.A, atol=0.2)


def test_motion_knows_of_missing_knots(rng):
    p = problem(rng, people=2, time_bins=12)
    rows = np.sort(rng.permutation(24)[:18])
    o = replace(p.o, person=p.o.person[rows], time_bin=p.o.time_bin[rows])
    V, _ = estimate_motion(o, p.truth.X[rows], np.ones((18, 3), dtype=bool))
    np.testing.assert_allclose(V, p.truth.V[rows], atol=0.1)


def test_noise_of_velocities_does_not_grow_with_the_rate(rng):
    noise = []
    for time_bins, step_s in ((300, 1 / 30), (600, 1 / 60)):
        p = problem(rng, people=1, time_bins=time_bins)
        o = replace(p.o, step_s=step_s)
        X = rng.standard_normal(p.truth.X.shape)
        V, _ = estimate_motion(o, X, np.ones(X.shape[:2], dtype=bool))
        noise.append(V[20:-20].std())
    assert noise[1] < noise[0]
