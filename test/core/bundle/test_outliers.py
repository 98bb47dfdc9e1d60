"""Joints that the images cannot tell from others, but bodies can."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from bundle_helpers import problem

from stcalib_ros.core.bundle.outliers import implausible_joints


def bodies():
    """Two people of four joints within .3 m of their middle, who walk, and variances of 1 cm."""
    p = problem(np.random.default_rng(0), people=2, time_bins=120, joints=4, missing=0.0)
    since, person = p.o.time_bin, p.o.person
    middle = np.stack([person * 2.0, 0.0 * since, 5.0 + since / 30], -1)
    X = middle[:, None] + np.random.default_rng(1).uniform(-0.3, 0.3, (1, 4, 3))
    return p.o, replace(p.truth, X=X), np.full(X.shape[:2], 1e-4)


def test_people_who_walk_are_plausible():
    assert not implausible_joints(*bodies()).any()


def test_a_joint_away_from_its_body_is_found():
    o, state, variance = bodies()
    X = state.X.copy()
    X[7, 2, 2] += 2.0
    found = implausible_joints(o, replace(state, X=X), variance)
    assert np.argwhere(found).tolist() == [[7, 2]]


def test_it_is_not_where_its_depth_is_not_known_to_that():
    o, state, variance = bodies()
    X = state.X.copy()
    X[7, 2, 2] += 2.0
    variance = variance.copy()
    variance[7, 2] = 1.0
    assert not implausible_joints(o, replace(state, X=X), variance).any()


def test_a_body_off_its_path_is_found():
    o, state, variance = bodies()
    X = state.X.copy()
    X[60:90, :, 2] += 4.0
    found = implausible_joints(o, replace(state, X=X), variance)
    assert found[60:90].all()
    assert not found[:60].any()
    assert not found[90:].any()


def test_joints_that_are_not_triangulated_are_not_judged():
    o, state, variance = bodies()
    variance = variance.copy()
    variance[:, 1] = np.nan
    variance[3] = np.nan
    assert not implausible_joints(o, state, variance).any()
