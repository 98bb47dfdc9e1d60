"""The Cramer-Rao bound, against dense information matrices and repeated estimates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundle_helpers import _arc
from core_helpers import SMALL
from scipy.interpolate import BSpline
from scipy.linalg import null_space
from scipy.stats import chi, chi2

from stcalib_ros.core.bundle.lenses import Lenses
from stcalib_ros.core.bundle.levenberg_marquardt import adjust
from stcalib_ros.core.bundle.parameters import Cameras, ParameterLayout
from stcalib_ros.core.evaluation.cramer_rao import (
    CramerRaoBound,
    TrueViews,
    expected_errors,
    free_point_bound,
    spline_bound,
    true_problem,
)
from stcalib_ros.core.evaluation.scene_truth import ScenePath, true_views
from stcalib_ros.core.geometry.radial import radial_profile
from stcalib_ros.core.geometry.so3 import exp_so3, log_so3
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.core.synthetic import simulate

STEP_S = 1 / 30


def path(times, order):
    """Two people of two joints, all under steady acceleration of their own."""
    rng = np.random.default_rng(3)
    start = rng.uniform([-1, -1, 4], [1, 1, 6], (2, 2, 3))
    V, A = rng.uniform(-2, 2, (2, 2, 2, 3)) * np.array([1, 5])[:, None, None, None]
    t = np.asarray(times)[:, None, None, None]
    return [start + V * t + 0.5 * A * t**2, V + A * t, A + 0.0 * t][order]


def scene(n_cameras=3, n_images=7, missing=0.2, seed=0):
    rng = np.random.default_rng(seed)
    R, t = _arc(rng, n_cameras)
    times = tuple(STEP_S * (np.arange(n_images) + rng.uniform(0, 0.4)) for _ in range(n_cameras))
    seen = tuple(rng.uniform(size=(n_images, 2, 2)) >= missing for _ in range(n_cameras))
    return TrueViews(R, t, rng.uniform(1300, 1500, n_cameras), times, seen, 2.0)


def moved(views, d):
    """Cameras after a step (C, 7) of rotation, translation and offset."""
    return replace(
        views, R_cam_ref=exp_so3(d[:, :3]) @ views.R_cam_ref, t_cam_ref=views.t_cam_ref + d[:, 3:6]
    )


def image(views, c, X, lens=(0.0, 0.0, 0.0, 0.0, 0.0)):
    """Image by a pinhole lens with corrections (5,)."""
    Y = views.R_cam_ref[c] @ X + views.t_cam_ref[c]
    u, (focal, x, y, k1, k2) = Y[:2] / Y[2], lens
    distorted = u * (1.0 + k1 * (u @ u) + k2 * (u @ u) ** 2)
    return ((1.0 + focal) * distorted + [x, y]) * views.focal_px[c] / views.sigma_px


def published(views, d):
    after = moved(views, d)
    R = after.R_cam_ref[0] @ np.swapaxes(after.R_cam_ref, 1, 2)
    centre = -np.einsum("cij,cj->ci", R, after.t_cam_ref)
    turned = log_so3(R @ views.R_cam_ref)
    unit = np.linalg.norm(moved(views, d).t_cam_ref[1])
    return np.concatenate([centre / unit, turned, d[:, 6:]], -1).ravel()


def jacobian(f, n, step=1e-6):
    return np.stack([(f(step * e) - f(-step * e)) / (2 * step) for e in np.eye(n)], -1)


def dense_floor(views, predicted, n_others, information=0.0, *, rates=False, turns=False):
    """The bound by one information matrix of all unknowns, the gauge fixed by its null space.

    Unknowns are steps of cameras (7 C), rates (C), and others; `predicted` maps them to the image
    points in units of the noise, `information` is what is known of the others beforehand. The
    reference camera may turn against the paths by 0.1 rad, if it `turns`.
    """
    C = len(views.observed)
    F = jacobian(predicted, 8 * C + n_others)
    H = F.T @ F
    H[8 * C :, 8 * C :] += information
    H[:3, :3] += turns * np.eye(3) / 0.1**2
    held = [*range(3 * turns, 7), 7 * C] + ([] if rates else list(range(7 * C + 1, 8 * C)))
    fixed = np.zeros((len(held) + 1, len(H)))
    fixed[range(len(held)), held] = 1.0
    cameras = Cameras(views.R_cam_ref, views.t_cam_ref, np.zeros(C))
    fixed[-1, : 7 * C] = ParameterLayout(C).scale_direction(cameras)
    free = null_space(fixed)
    P = free @ np.linalg.inv(free.T @ H @ free) @ free.T
    G = jacobian(lambda d: published(views, d.reshape(C, 7)), 7 * C)
    return G @ P[: 7 * C, : 7 * C] @ G.T, np.sqrt(np.diag(P)[7 * C :])


def dense_free_points(views, *, rates=False, known=()):
    """The bound with joints that are free, and with lenses of which so much is `known` (5,)."""
    o, state = true_problem(views, path)
    C, used = len(views.observed), np.argwhere(state.inlier)
    points = np.argwhere(state.inlier.any(1))
    middle = views.middle_s - views.start_s
    n_lens = len(known) * C

    def predicted(d):
        cameras, rate = d[: 7 * C].reshape(C, 7), d[7 * C : 8 * C]
        lens = np.zeros((C, 5)) if not n_lens else d[8 * C : 8 * C + n_lens].reshape(C, 5)
        d = np.delete(d, slice(8 * C, 8 * C + n_lens))
        X, after = state.X.copy(), moved(views, cameras)
        for i, (n, j) in enumerate(points):
            X[n, j] += d[8 * C + 3 * i : 8 * C + 3 * i + 3]
        out = []
        for n, c, j in used:
            late = cameras[c, 6] + rate[c] * (o.time_bin[n] * o.step_s - middle)
            when = o.phi[n, c] + late
            out.append(
                image(
                    *(after, c, X[n, j] + when * state.V[n, j] + 0.5 * when**2 * state.A[n, j]),
                    lens[c],
                )
            )
        return np.concatenate(out)

    n_others = n_lens + 3 * len(points)
    information = np.diag(np.pad(np.tile(known, C), (0, n_others - n_lens)))
    return dense_floor(views, predicted, n_others, information, rates=rates, turns=n_lens > 0)


def assert_same(found: CramerRaoBound, covariance, stddev=None):
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-30))
    size[:7] = 1.0
    difference = (found.covariance - covariance) / np.outer(size, size)
    np.testing.assert_allclose(difference, 0, atol=2e-4)
    if stddev is not None:
        np.testing.assert_allclose(found.rate_stddev, stddev, rtol=1e-4)


@pytest.mark.parametrize("n_cameras", [2, 3])
def test_free_points_are_those_of_the_dense_information(n_cameras):
    views = scene(n_cameras)
    found = free_point_bound(views, path)
    assert_same(found, dense_free_points(views)[0])
    assert np.isnan(found.rate_stddev).all()


def test_rates_are_those_of_the_dense_information():
    views = scene(3)
    covariance, stddev = dense_free_points(views, rates=True)
    assert_same(free_point_bound(views, path, rates=True), covariance, stddev[:3])


def lenses(views, free, stddev):
    """Pinhole lenses of which these corrections (5,) are estimated."""
    intrinsics = tuple(
        Intrinsics(1920, 1080, LensModel.PLUMB_BOB, np.diag([f, f, 1.0]), np.zeros(0))
        for f in views.focal_px
    )
    C = len(intrinsics)
    free, stddev = (np.repeat(np.array(one)[:, None], C, 1) for one in (free, stddev))
    profile = radial_profile(intrinsics)
    return Lenses(intrinsics, profile, free, np.zeros((5, C)), stddev, np.arange(C))


def test_lenses_are_those_of_the_dense_information():
    views = scene(3, n_images=9, missing=0.0)
    stddev = np.array([np.inf, 0.01, 0.02, 0.5, 0.6])
    unknown = replace(views, lenses=lenses(views, (True,) * 5, stddev))
    found = free_point_bound(unknown, path)
    covariance, others = dense_free_points(views, known=1.0 / stddev**2)
    assert_same(found, covariance)
    np.testing.assert_allclose(found.lens_stddev.T.ravel(), others[3:18], rtol=1e-3)


@pytest.mark.parametrize("floor", [free_point_bound, spline_bound])
def test_lenses_that_are_unknown_make_poses_less_certain(floor):
    views = scene(3, n_images=20, missing=0.0)
    known, focal, focal_and_k1 = (
        floor(
            replace(views, lenses=lenses(views, free, (np.inf, 0.01, 0.01, np.inf, np.inf))), path
        )
        for free in ((False,) * 5, (True, *(False,) * 4), (True, False, False, True, False))
    )
    assert_same(known, floor(views, path).covariance)
    assert np.isnan(known.lens_stddev).all()
    assert np.isnan(focal.lens_stddev[1:]).all()
    assert (focal_and_k1.lens_stddev[0] > 1.01 * focal.lens_stddev[0]).all()
    areas = [np.trace(one.covariance[7:, 7:]) for one in (known, focal, focal_and_k1)]
    assert areas == sorted(areas)


def test_a_lens_with_distortion_has_fewer_pixels_for_an_angle():
    views = scene(3, n_images=20, missing=0.0)
    straight = lenses(views, (False,) * 5, (np.inf,) * 5)
    bent = tuple(replace(one, D=np.array([-0.3, 0, 0, 0])) for one in straight.intrinsics)
    sharper = replace(views, lenses=straight)
    blunt = replace(views, lenses=replace(straight, intrinsics=bent, profile=radial_profile(bent)))
    one, other = (np.trace(free_point_bound(v, path).covariance) for v in (sharper, blunt))
    assert other > 1.02 * one


@pytest.mark.parametrize("rates", [False, True])
def test_splines_are_those_of_the_dense_information(rates):
    views = scene(3)
    C, h = len(views.observed), views.step_s
    K = 4 + max(int((t[-1] - views.start_s) / h) for t in views.times_s)
    time_bins = views.start_s + h * np.arange(-3, K + 1)
    used = [(c, *m) for c in range(C) for m in np.argwhere(views.observed[c])]
    variance = (path(np.arange(3), 2) ** 2).mean((0, 3)).ravel() * h**4
    # Quadratic paths are in the space of the splines: differences are by the coefficients.
    second = np.diff(np.eye(K), 2, axis=0)
    prior = np.kron(np.kron(np.diag(1 / variance), second.T @ second), np.eye(3))

    def predicted(d):
        cameras, rate = d[: 7 * C].reshape(C, 7), d[7 * C : 8 * C]
        after, change = moved(views, cameras), d[8 * C :].reshape(2, 2, K, 3)
        out = []
        for c, k, p, j in used:
            t = views.times_s[c][k]
            late = cameras[c, 6] + rate[c] * (t - views.middle_s)
            X = path([t + late], 0)[0, p, j] + BSpline(time_bins, change[p, j], 3)(t)
            out.append(image(after, c, X))
        return np.concatenate(out)

    covariance, stddev = dense_floor(views, predicted, 4 * K * 3, prior, rates=rates)
    found = spline_bound(views, path, rates=rates)
    assert_same(found, covariance, stddev[:C] if rates else None)


def test_estimates_of_greatest_likelihood_scatter_by_the_floor():
    views = scene(3, n_images=40, missing=0.1)
    o, truth = true_problem(views, path)
    floor = free_point_bound(views, path).covariance[7:, 7:]
    size = np.sqrt(np.diag(floor))
    value, vector = np.linalg.eigh(floor / np.outer(size, size))
    free = value > 1e-6
    lengths = []
    for seed in range(60):
        noise = views.sigma_px * np.random.default_rng(seed).normal(size=o.x.shape)
        x = np.where(o.observed[..., None], o.x + noise / o.focal[..., None], 0.0)
        found = adjust(replace(o, x=x), truth, iterations=30, tolerance=1e-3)
        d = np.concatenate(
            [
                log_so3(found.R_cam_ref @ np.swapaxes(truth.R_cam_ref, 1, 2)),
                found.t_cam_ref - truth.t_cam_ref,
                found.shift_s[:, None],
            ],
            -1,
        )
        e = (published(views, d) - published(views, 0.0 * d))[7:] / size
        lengths.append(((e @ vector[:, free]) ** 2 / value[free]).sum())
    n = 60 * int(free.sum())
    assert free.sum() == 13
    # The robust loss gives five percent of its efficiency away.
    low, high = chi2.ppf([1e-3, 1 - 1e-3], n) / n
    assert low < np.sum(lengths) / n * 0.95 < high


@pytest.mark.parametrize("floor", [free_point_bound, spline_bound])
def test_more_that_is_seen_is_never_worse(floor):
    views = scene(3, n_images=12)
    rng = np.random.default_rng(5)
    fewer = tuple(s & (rng.uniform(size=s.shape) < 0.7) for s in views.observed)
    all_of_it, part = (floor(v, path).covariance for v in (views, replace(views, observed=fewer)))
    size = np.sqrt(np.diag(part)[7:])
    gain = (part - all_of_it)[7:, 7:] / np.outer(size, size)
    assert np.linalg.eigvalsh(gain)[0] > -1e-6
    assert np.trace(gain) > 1.0


def test_twice_the_noise_is_twice_the_deviation():
    views = scene(3)
    one, two = (
        free_point_bound(replace(views, sigma_px=sigma), path).covariance for sigma in (1.5, 3.0)
    )
    np.testing.assert_allclose(two, 4 * one, rtol=1e-6, atol=1e-12 * np.abs(two).max())


def test_mean_errors_of_a_known_scatter():
    covariance = np.zeros((21, 21))
    for c in (1, 2):
        block = np.diag([0.01**2] * 3 + [0.02**2] * 3 + [0.003**2])
        covariance[7 * c : 7 * c + 7, 7 * c : 7 * c + 7] = block
    lens_stddev = np.repeat([[0.01], [np.nan], [np.nan], [0.02], [np.nan]], 3, 1)
    floor = CramerRaoBound(covariance, np.full(3, np.nan), lens_stddev)
    found = expected_errors(floor, np.random.default_rng(0), n=20_000)
    maxwell = np.sqrt(8 / np.pi)
    np.testing.assert_allclose(found.E_R, 0.02 * maxwell, rtol=0.01)
    np.testing.assert_allclose(found.E_delta_s, 0.003 * np.sqrt(2 / np.pi), rtol=0.01)
    np.testing.assert_allclose(found.E_t, 0.01 * chi.mean(6) / np.sqrt(2), rtol=0.01)
    np.testing.assert_allclose([found.E_f, found.E_k1], np.array([0.01, 0.02]) * chi.mean(1))


@pytest.fixture(scope="module")
def simulated():
    return simulate(replace(SMALL, flip_rate=0.0))


def test_what_is_true_of_a_scene_projects_to_what_was_seen(simulated):
    views, true_path = true_views(simulated), ScenePath(simulated)
    for c, camera in enumerate(simulated.recording.cameras):
        X = true_path(views.times_s[c], 0)
        Y = X @ views.R_cam_ref[c].T + views.t_cam_ref[c]
        pixels = Y[..., :2] / Y[..., 2:] * views.focal_px[c] + [960, 540]
        errors = []
        for track in camera.tracks:
            persons = simulated.track_persons[camera.name][track.track_id]
            errors.append(track.keypoints - pixels[track.frames, persons])
            known = np.isfinite(track.keypoints[..., 0])
            assert (views.observed[c][track.frames, persons] == known).all()
        assert np.nanstd(np.concatenate(errors)) == pytest.approx(3.0, rel=0.05)


def test_derivatives_of_true_paths_are_those_of_differences(simulated):
    true_path, times = ScenePath(simulated), np.array([0.5, 1.0, 1.5])
    for order in (0, 1):
        d = 1e-5
        change = (true_path(times + d, order) - true_path(times - d, order)) / (2 * d)
        np.testing.assert_allclose(change, true_path(times, order + 1), atol=1e-2, rtol=1e-3)
