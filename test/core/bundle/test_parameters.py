"""The layout of unknowns, and one more unknown than there are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundle_helpers import disturbed, problem

from stcalib_ros.core.bundle.covariance import JointCovariance, information, publication
from stcalib_ros.core.bundle.levenberg_marquardt import adjust
from stcalib_ros.core.bundle.parameters import (
    CLOCK_SKEW,
    FURTHER_UNKNOWNS,
    LINE_DELAY,
    POSE_AND_CLOCK,
    TIME_OFFSET,
    TRANSLATION,
    Cameras,
    CameraUnknown,
    ParameterLayout,
)
from stcalib_ros.core.bundle.point_views import PointTimes, PointView
from stcalib_ros.core.bundle.residuals import camera_points
from stcalib_ros.core.bundle.scaled_system import propagate
from stcalib_ros.core.geometry.so3 import exp_so3

EVERY = np.ones(3, dtype=bool)


def _stretched(view):
    return (view.Z * np.array([1.0, 1.0, 0.0])[:, None])[..., None, :, :]


FOCAL_FACTOR = CameraUnknown("focal_factor", "1", relative=False, displacements=_stretched)
"""Relative error of the focal length: image points move along their radius."""


def cameras(rng):
    R = exp_so3(rng.normal(scale=0.3, size=(3, 3)))
    return Cameras(R, rng.normal(size=(3, 3)), 0.01 * rng.normal(size=3))


# One more unknown


def seen_with(p, factors):
    """The observations and the state of a problem whose cameras have other focal lengths."""
    truth = replace(p.truth, further={FOCAL_FACTOR: factors})
    Z = camera_points(p.o, truth)
    x = np.where(p.o.observed[..., None], Z[..., :2] / Z[..., 2:], 0.0)
    return replace(p.o, x=x), truth


def test_one_more_unknown_is_estimated_and_has_a_covariance():
    factors = np.array([0.02, -0.01, 0.015])
    rng = np.random.default_rng(5)
    p = problem(rng, people=6, time_bins=30, joints=8, sigma_px=0.0, offset_s=0.0)
    o, truth = seen_with(p, factors)
    noise = rng.normal(size=o.x.shape) / o.focal[..., None]
    o = replace(o, x=np.where(o.observed[..., None], o.x + noise, 0.0))
    layout = truth.layout.with_unknown(FOCAL_FACTOR, EVERY)
    start = disturbed(rng, replace(truth, further={}), 0.003)
    end = adjust(o, start, iterations=100, tolerance=1e-4, layout=layout)
    P = information(o, end, layout).covariance(layout)
    joint = JointCovariance(("a", "b", "c"), layout, P, publication(end.cameras, layout))
    for name, found, true in zip("abc", end.further[FOCAL_FACTOR], factors, strict=True):
        stddev = float(joint.stddev(f"{name}.focal_factor")[0])
        assert 0.0 < stddev < 0.005
        assert abs(found - true) < 4.0 * stddev
    assert "b.focal_factor" in joint.names
    assert joint.covariance("b.translation", "c.focal_factor").shape == (3, 1)


# Derivatives


@pytest.mark.parametrize("unknown", [*POSE_AND_CLOCK, *FURTHER_UNKNOWNS, FOCAL_FACTOR])
def test_displacements_are_those_of_a_small_step(rng, unknown):
    """Of a point whose path is known, in the frame of each camera."""
    here, X, V = cameras(rng), rng.normal(size=(3, 6)), rng.normal(size=(3, 6))
    times = PointTimes(rng.normal(size=6), rng.uniform(-500, 500, (3, 6)))

    def seen(at):
        y = at.R @ X + at.delay(times)[:, None] * (at.R @ V)
        Z = y + at.t[:, :, None]
        view = PointView(y, at.R @ V, Z, times)
        return at.displaced(view), view

    derivative = unknown.derivative(seen(here)[1])
    for k in range(unknown.size):
        h = 1e-6 * np.eye(unknown.size)[k] * np.ones((3, 1))
        ahead, behind = (seen(unknown.stepped(here, sign * h))[0] for sign in (1, -1))
        numeric = (ahead - behind) / 2e-6
        np.testing.assert_allclose(numeric, derivative[:, k], atol=1e-5 * np.abs(numeric).max())


def test_an_unknown_without_effect_is_refused(rng):
    view = PointView(*np.zeros((3, 1, 3, 2)), PointTimes(np.zeros(2), np.zeros((1, 2))))
    with pytest.raises(TypeError, match="unknown idle: needs a delay or displacements"):
        CameraUnknown("idle", "1").derivative(view)


# The layout


def layout_of_all():
    some = np.array([False, True, False])
    return ParameterLayout(3).with_unknown(CLOCK_SKEW, some).with_unknown(LINE_DELAY, EVERY)


def test_what_is_estimated_is_free():
    layout = layout_of_all()
    free = layout.free()
    assert layout.block == 9
    assert np.isin(layout.scalars(LINE_DELAY), free).all()
    np.testing.assert_array_equal(np.isin(layout.scalars(CLOCK_SKEW), free), [False, True, False])
    np.testing.assert_array_equal(np.isin(layout.columns(TRANSLATION)[:, 0], free), [0, 1, 1])
    assert len(free) == 2 * 7 + 1 + 3


def test_synchronised_clocks_are_no_unknowns():
    layout = replace(layout_of_all(), synchronised=True)
    free = layout.free()
    for unknown in (TIME_OFFSET, CLOCK_SKEW):
        assert not np.isin(layout.scalars(unknown), free).any()
    assert np.isin(layout.scalars(LINE_DELAY), free).all()


def test_columns_of_common_unknowns_are_found_in_both_layouts():
    one, other = layout_of_all(), ParameterLayout(3).with_unknown(LINE_DELAY, EVERY)
    mine, theirs = one.common(other)
    assert len(mine) == len(theirs) == other.size
    np.testing.assert_array_equal(
        np.sort(mine), np.setdiff1d(np.arange(one.size), one.scalars(CLOCK_SKEW))
    )


def test_a_step_along_the_scale_is_no_part_of_a_solution(rng):
    layout, here = ParameterLayout(3), cameras(rng)
    A = rng.normal(size=(60, layout.size))
    step = layout.solve(A.T @ A, A.T @ rng.normal(size=60), here).ravel()
    assert abs(step @ layout.scale_direction(here)) < 1e-12 * np.linalg.norm(step)
    assert not step[layout.of_camera(0)].any()


def test_the_direction_of_the_scale_is_the_gradient_of_the_spread(rng):
    layout, here = ParameterLayout(3), cameras(rng)
    numeric = [
        (layout.retract(here, s).length() - layout.retract(here, -s).length()) / 2e-6
        for s in 1e-6 * np.eye(layout.size).reshape(-1, 3, layout.block)
    ]
    expected = np.array(numeric) / np.linalg.norm(numeric)
    np.testing.assert_allclose(layout.scale_direction(here), expected, atol=1e-7)


# What is not observable


def test_what_is_not_observable_has_an_infinite_variance(rng):
    layout, here = ParameterLayout(3), cameras(rng)
    A = rng.normal(size=(60, layout.size))
    lost = layout.scalars(TIME_OFFSET)[2]
    A[:, lost] = 0.0
    P = layout.inverse(A.T @ A, here)
    assert np.isinf(P[lost, lost])
    others = np.delete(np.arange(layout.size), lost)
    assert np.isfinite(P[np.ix_(others, others)]).all()
    assert not P[lost, others].any()
    joint = JointCovariance(("a", "b", "c"), layout, P, publication(here, layout))
    assert np.isinf(joint.stddev("c.time_offset")).all()
    assert np.isfinite(joint.stddev("c.translation")).all()


def test_two_unknowns_of_one_effect_are_both_not_observable(rng):
    layout, here = ParameterLayout(3), cameras(rng)
    A = rng.normal(size=(60, layout.size))
    one, other = layout.scalars(TIME_OFFSET)[1:]
    A[:, other] = A[:, one]
    P = layout.inverse(A.T @ A, here)
    assert np.isinf(np.diag(P)[[one, other]]).all()


def test_infinite_variances_stay_where_they_are_propagated():
    P = np.diag([1.0, np.inf, 4.0])
    J = np.array([[1.0, 0.0, 1.0], [0.0, 2.0, 0.0], [1.0, 1.0, 0.0]])
    np.testing.assert_array_equal(propagate(J, P), np.diag([5.0, np.inf, np.inf]))
