"""Predicted deviations against those of repeated experiments."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundle_helpers import disturbed, problem
from scipy.stats import chi2

from stcalib_ros.core.bundle.covariance import (
    CENTRE_ROWS,
    PARAMETERS,
    clusters,
    pose_covariance,
    rows_of,
    with_known_distance,
)
from stcalib_ros.core.bundle.gauge import camera_centres
from stcalib_ros.core.bundle.levenberg_marquardt import adjust
from stcalib_ros.core.bundle.limits import SHORTEST_CLUSTER
from stcalib_ros.core.bundle.residuals import camera_points
from stcalib_ros.core.geometry.so3 import exp_so3, log_so3


def published(state):
    """Parameters (7 C,) as they are published: centre, rotation about reference axes, offset."""
    R = np.swapaxes(state.R_cam_ref, 1, 2)
    centre = -np.einsum("cij,cj->ci", R, state.t_cam_ref)
    return R, centre, state.shift_s


def difference(state, truth):
    R, centre, shift = published(state)
    R_true, centre_true, shift_true = published(truth)
    turned = log_so3(R @ np.swapaxes(R_true, 1, 2))
    return np.concatenate([centre - centre_true, turned, (shift - shift_true)[:, None]], -1).ravel()


def noisy(p, rng, sigma_px):
    noise = sigma_px * rng.normal(size=p.o.x.shape) / p.o.focal[..., None]
    return replace(p.o, x=np.where(p.o.observed[..., None], p.o.x + noise, 0))


def experiments(n, *, cameras, sigma_px=2.0):
    """Differences from the truth (n, 7 C) and predicted covariances (n, 7 C, 7 C)."""
    exact = problem(
        np.random.default_rng(0), cameras=cameras, time_bins=60, joints=4, sigma_px=0, missing=0.1
    )
    errors, predicted = [], []
    for seed in range(n):
        o = noisy(exact, np.random.default_rng(seed), sigma_px)
        state = adjust(o, exact.truth, iterations=30, tolerance=1e-4)
        errors.append(difference(state, exact.truth))
        predicted.append(pose_covariance(o, state))
    return np.array(errors), np.array(predicted)


@pytest.fixture(scope="module")
def repeated():
    return experiments(40, cameras=5)


def test_predicted_deviations_are_those_of_repeated_experiments(repeated):
    errors, predicted = repeated
    free = np.arange(7, errors.shape[1])
    deviation = np.sqrt(predicted.mean(0)[free, free])
    square = ((errors[:, free] / deviation) ** 2).mean(0)
    # 40 experiments: the mean square is chi-square over its degrees of freedom, of each of the
    # 28 parameters.
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 40) / 40
    assert (square > low).all(), square
    assert (square < high).all(), square
    assert 1 / 1.3 < square.mean() < 1.3, square.mean()


def test_errors_have_no_bias(repeated):
    errors, predicted = repeated
    free = np.arange(7, errors.shape[1])
    deviation = np.sqrt(predicted.mean(0)[free, free] / len(errors))
    assert np.abs(errors[:, free].mean(0) / deviation).max() < 4.5


def test_a_covariance_is_symmetric_and_positive(repeated):
    for P in repeated[1][:5]:
        np.testing.assert_allclose(P, P.T, atol=1e-12 * np.abs(P).max())
        assert np.linalg.eigvalsh(P)[0] > -1e-9 * np.abs(P).max()


def test_the_reference_is_certain_and_so_is_the_spread_of_the_cameras():
    p = problem(np.random.default_rng(2), cameras=3, time_bins=40)
    state = adjust(p.o, p.truth, iterations=20, tolerance=1e-3)
    P = pose_covariance(p.o, state)
    assert not P[:7].any()
    assert not P[:, :7].any()
    centres = camera_centres(state.R_cam_ref, state.t_cam_ref)
    rows = rows_of(np.arange(3))[:, CENTRE_ROWS].ravel()
    outward = (centres - centres.mean(0)).ravel() / np.linalg.norm(centres - centres.mean(0))
    assert outward @ P[np.ix_(rows, rows)] @ outward < 1e-9 * np.trace(P[np.ix_(rows, rows)])


def test_a_known_distance_is_certain():
    p = problem(np.random.default_rng(2), cameras=3, time_bins=40)
    state = adjust(p.o, p.truth, iterations=20, tolerance=1e-3)
    centres = camera_centres(state.R_cam_ref, state.t_cam_ref)
    P = with_known_distance(pose_covariance(p.o, state), centres, 1, 2)
    one, other = rows_of(np.array([1, 2]))[:, CENTRE_ROWS]
    gradient = np.zeros(len(P))
    gradient[one], gradient[other] = centres[1] - centres[2], centres[2] - centres[1]
    assert not P[:7].any()
    assert gradient @ P @ gradient < 1e-12 * (gradient**2).sum() * np.trace(P)
    again = with_known_distance(P, centres, 0, 1)
    direct = with_known_distance(pose_covariance(p.o, state), centres, 0, 1)
    np.testing.assert_allclose(again, direct, atol=1e-9 * np.abs(direct).max())


def test_cameras_at_one_place_give_no_unit():
    P = np.diag(np.arange(1.0, 22.0))
    centres = np.array([[0.0, 0, 0], [0, 0, 0], [3, 0, 0]])
    np.testing.assert_array_equal(with_known_distance(P, centres, 0, 1), P)


def test_twice_the_noise_is_twice_the_deviation():
    exact = problem(np.random.default_rng(3), cameras=4, time_bins=60, joints=4, sigma_px=0)
    deviations = []
    for sigma_px in (2.0, 4.0):
        o = noisy(exact, np.random.default_rng(0), sigma_px)
        state = adjust(o, exact.truth, iterations=30, tolerance=1e-4)
        deviations.append(np.sqrt(np.diag(pose_covariance(o, state))[7:]))
    np.testing.assert_allclose(deviations[1] / deviations[0], 2, rtol=0.15)


def test_the_unit_of_lengths_is_that_of_the_state():
    p = problem(np.random.default_rng(4), cameras=3, time_bins=40)
    state = adjust(p.o, p.truth, iterations=20, tolerance=1e-3)
    lengths = ("t_cam_ref", "X", "V", "A")
    enlarged = replace(state, **{name: 5 * getattr(state, name) for name in lengths})
    grow = np.tile([5, 5, 5, 1, 1, 1, 1], 3)
    small, large = pose_covariance(p.o, state), pose_covariance(p.o, enlarged)
    deviation = np.sqrt(np.diag(small)[7:])
    size = np.outer(deviation, deviation)
    shrunk = large / np.outer(grow, grow)
    np.testing.assert_allclose(shrunk[7:, 7:] / size, small[7:, 7:] / size, atol=1e-4)


def test_parameters_are_those_of_the_result():
    assert PARAMETERS == ("x", "y", "z", "rot_x", "rot_y", "rot_z", "time_offset_s")


@pytest.mark.parametrize(("n_unknowns", "expected"), [(1, 150), (26, 75), (100, 18), (10_000, 9)])
def test_spans_of_clusters_are_halved_down_to_the_shortest(n_unknowns, expected):
    """Clusters of the only joint of one person over 600 time bins."""
    p = problem(np.random.default_rng(1), people=1, time_bins=600, joints=10)
    known = np.ones((600, 10), dtype=bool)
    found = clusters(p.o, known, n_unknowns=n_unknowns)
    first = found[:, 0]
    lengths = np.diff(np.flatnonzero(np.diff(first, prepend=-1, append=-1)))
    assert lengths.max() == expected
    assert expected >= SHORTEST_CLUSTER


def with_two_at_one_place(rng):
    """A problem whose first two cameras stand at one place, the third elsewhere."""
    p = problem(rng, cameras=3, time_bins=40, joints=6, sigma_px=0.0)
    R, t = p.truth.R_cam_ref.copy(), p.truth.t_cam_ref.copy()
    R[1], t[1] = exp_so3(np.array([0.1, -0.2, 0.05])), 0.0
    truth = replace(p.truth, R_cam_ref=R, t_cam_ref=t)
    Z = camera_points(p.o, truth)
    x = np.where(p.o.observed[..., None], Z[..., :2] / Z[..., 2:], 0.0)
    return noisy(replace(p, o=replace(p.o, x=x)), rng, 1.0), truth


def test_the_first_two_cameras_may_stand_at_one_place():
    rng = np.random.default_rng(8)
    o, truth = with_two_at_one_place(rng)
    state = adjust(o, disturbed(rng, truth, 0.003), iterations=50, tolerance=1e-3)
    P = pose_covariance(o, state)
    assert np.isfinite(P).all()
    stddev = np.sqrt(np.diag(P)[7:])
    assert (stddev < 0.02).all()
    assert (np.abs(difference(state, truth)[7:]) < 5.0 * stddev).all()
