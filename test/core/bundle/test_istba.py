"""Rounds of association, adjustment and removal of outliers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundle_helpers import problem

from stcalib_ros.core.bundle.istba import _every_slot
from stcalib_ros.core.bundle.outliers import connected, drop_outliers
from stcalib_ros.core.bundle.residuals import errors_px
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rig import Rig, sub_rig
from stcalib_ros.core.options import BundleOptions


def rig_of(rng, n=4):
    return Rig(
        np.array([2, 0, 3, 5])[:n],
        exp_so3(rng.normal(size=(n, 3))),
        rng.normal(size=(n, 3)),
        rng.normal(size=n),
        1.0,
    )


# Outliers


def displaced(p, cells, px):
    x = p.o.x.copy()
    for cell in cells:
        x[cell] += [px / p.o.focal[cell], 0]
    return replace(p, o=replace(p.o, x=x))


def test_what_is_far_off_is_dropped(rng):
    p = problem(rng, cameras=4, time_bins=20, missing=0)
    cells = [(3, 1, 0), (7, 2, 1), (12, 0, 2)]
    p = displaced(p, cells, 60.0)
    state = drop_outliers(p.o, p.truth, BundleOptions())
    dropped = np.argwhere(p.o.observed & ~state.inlier)
    assert {tuple(c) for c in dropped.tolist()} == set(cells)


def test_nothing_is_dropped_below_the_floor(rng):
    p = displaced(problem(rng, cameras=4, sigma_px=0.1, missing=0), [(3, 1, 0)], 11.0)
    state = drop_outliers(p.o, p.truth, BundleOptions())
    np.testing.assert_array_equal(state.inlier, p.o.observed)
    tighter = drop_outliers(p.o, p.truth, BundleOptions(outlier_floor_px=5.0))
    assert not tighter.inlier[3, 1, 0]


def test_points_left_with_one_view_are_dropped_whole(rng):
    p = displaced(problem(rng, cameras=2, missing=0), [(3, 1, 0)], 60.0)
    state = drop_outliers(p.o, p.truth, BundleOptions())
    assert not state.inlier[3, :, 0].any()
    assert state.inlier[3, :, 1].all()


def test_what_fits_again_is_taken_back(rng):
    p = problem(rng, missing=0)
    nothing = replace(p.truth, inlier=p.o.observed & (np.arange(3) != 1))
    state = drop_outliers(p.o, nothing, BundleOptions())
    known = nothing.inlier.sum(1) >= 2
    everywhere = np.broadcast_to(known[:, None], p.o.observed.shape)
    assert (state.inlier == p.o.observed)[everywhere].all()


def test_without_any_observation_nothing_is_used(rng):
    p = problem(rng)
    nobody = replace(p.truth, inlier=np.zeros_like(p.o.observed))
    assert not drop_outliers(p.o, nobody, BundleOptions()).inlier.any()


# What holds together


def shared(pairs, n_cameras, n_points):
    """Observations (N, C, 1) in which each pair of cameras shares so many points."""
    used = np.zeros((len(pairs) * n_points, n_cameras, 1), dtype=bool)
    for k, (a, b) in enumerate(pairs):
        used[k * n_points : (k + 1) * n_points, [a, b]] = True
    return used


def total(used):
    return used.sum((0, 2))


def test_a_chain_of_cameras_holds_together():
    used = shared([(0, 1), (2, 1), (3, 2)], 4, 100)
    assert connected(used, total(used)) == [(0, 1, 2, 3)]


def test_groups_come_with_the_largest_first():
    used = shared([(0, 4), (1, 2), (2, 3)], 6, 150)
    assert connected(used, total(used)) == [(1, 2, 3), (0, 4), (5,)]


@pytest.mark.parametrize(("n", "groups"), [(99, [(0,), (1,)]), (100, [(0, 1)])])
def test_a_hundred_common_points_are_a_tie(n, groups):
    used = shared([(0, 1)], 2, n)
    assert connected(used, total(used)) == groups


def test_a_stray_match_of_strangers_is_no_tie():
    used = shared([(0, 1)], 2, 150)
    assert connected(used, np.array([10_000, 10_000])) == [(0,), (1,)]
    assert connected(used, np.array([10_000, 1_400])) == [(0, 1)]


# Parts of a rig


def test_a_part_of_a_rig_is_in_the_frame_and_clock_of_its_first_camera(rng):
    rig = rig_of(rng)
    part = sub_rig(rig, [2, 0, 3])
    np.testing.assert_array_equal(part.cameras, rig.cameras[[2, 0, 3]])
    np.testing.assert_allclose(part.R_ref_cam[0], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(part.t_ref_cam[0], 0, atol=1e-12)
    assert part.offset_s[0] == 0
    x_cam = rng.normal(size=(3, 3))
    for i, k in enumerate([2, 0, 3]):
        in_whole = rig.R_ref_cam[k] @ x_cam[i] + rig.t_ref_cam[k]
        in_part = part.R_ref_cam[i] @ x_cam[i] + part.t_ref_cam[i]
        back = rig.R_ref_cam[2] @ in_part + rig.t_ref_cam[2]
        np.testing.assert_allclose(back, in_whole, atol=1e-12)
        assert part.offset_s[i] == rig.offset_s[k] - rig.offset_s[2]


# A whole calibration


def test_rounds_lower_the_error_of_what_is_used(small_stages):
    rounds = small_stages.iterations
    assert len(rounds) >= 2
    errors = [errors_px(r.observations, r.state) for r in rounds]
    final = errors[-1][rounds[-1].state.inlier]
    assert np.sqrt(np.mean(final**2)) < 3.5
    assert rounds[-1].median_px <= rounds[0].median_px + 0.2


def test_the_truth_fits_better_than_a_wrong_pose(small_stages):
    last = small_stages.iterations[-1]
    t = last.state.t_cam_ref.copy()
    t[2] += [0.3, 0.0, 0.0]
    wrong = replace(last, state=replace(last.state, t_cam_ref=t))
    assert last.fit(8.0) > wrong.fit(8.0)


# Long recordings


@pytest.mark.parametrize(("n_frames", "every"), [(300, 1), (1150, 1), (1250, 2), (6050, 10)])
def test_long_recordings_are_looked_at_in_parts_until_the_last_round(n_frames, every):
    stamps = np.arange(n_frames) / 30
    cameras = [LiftedCamera("a", stamps, ()), LiftedCamera("b", stamps[:5], ())]
    rig = replace(rig_of(np.random.default_rng(0), 2), cameras=np.array([1, 0]))
    assert _every_slot(cameras, rig, 1 / 30) == every
