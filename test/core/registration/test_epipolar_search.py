"""Lags, persons and matrices of two cameras, from exact keypoints."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from core_helpers import EXACT, FRAME_S, lifted
from epipolar_helpers import direction_error, true_pair

from stcalib_ros.core.geometry.epipolar import decompose_essential
from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.options import RegistrationOptions
from stcalib_ros.core.registration.epipolar_correlation import (
    best_essential,
    keypoint_moments,
    moments_at,
    pencil,
)
from stcalib_ros.core.registration.epipolar_search import search
from stcalib_ros.core.registration.resampling import common_grid
from stcalib_ros.core.synthetic import simulate

OPTIONS = RegistrationOptions()
ONE_CLOCK = replace(EXACT, seed=1)


def searched(a, b, *, max_lag=30, options=OPTIONS):
    grid = common_grid((a, b))
    return search(
        keypoint_moments(a, grid),
        keypoint_moments(b, grid),
        max_lag=max_lag,
        step_s=grid.step_s,
        options=options,
    )


def distances(a, b, found):
    """Distances of the best matrix of an agreement and of the next independent one."""
    moments = [keypoint_moments(camera, common_grid((a, b))) for camera in (a, b)]
    c = sum(moments_at(*moments, p, q, round(found.lag)) for p, q in found.matches)
    return np.sqrt(best_essential(*pencil(c))[0])


@pytest.fixture(scope="module")
def scene():
    """Clocks that are off by fractions of a frame."""
    made = simulate(replace(EXACT, max_offset_frames=4, seed=3))
    return made, lifted(made.recording)[1]


@pytest.fixture(scope="module")
def strangers():
    return lifted(simulate(replace(EXACT, seed=78)).recording)[1]


def assert_found(best, truth, *, frames=0.05, rad=0.02):
    assert best.lag * FRAME_S == pytest.approx(truth.lag_s, abs=frames * FRAME_S)
    assert set(best.matches) == set(truth.matches)
    poses = decompose_essential(best.E)
    assert min(rotation_angle(R.T @ truth.R_a_b) for R, _ in poses) < rad
    assert min(direction_error(t, truth.t_a_b) for _, t in poses) < rad


@pytest.mark.parametrize("pair", [(0, 1), (0, 2), (0, 3), (2, 1), (3, 2)])
def test_lag_between_samples_persons_and_matrix_are_found(scene, pair):
    made, cameras = scene
    found = searched(*(cameras[c] for c in pair))
    assert_found(found[0], true_pair(made, *pair))
    assert found[0].points > 3000
    # Images are interpolated linearly, in one camera at least.
    assert found[0].error_px < 2
    best, following = distances(*(cameras[c] for c in pair), found[0])
    assert following > 10 * best


def test_the_best_supported_comes_first_and_all_differ(scene):
    _, cameras = scene
    found = searched(cameras[0], cameras[1])
    assert 1 < len(found) <= OPTIONS.n_refined
    support = [one.support for one in found]
    assert support == sorted(support, reverse=True)
    assert support[0] > 3 * support[1]
    for one in found[1:]:
        assert abs(one.lag - found[0].lag) > 3 or set(one.matches) != set(found[0].matches)


def test_as_many_are_kept_as_the_options_say(scene):
    _, cameras = scene
    one = searched(cameras[0], cameras[1], options=replace(OPTIONS, n_refined=1))
    assert len(one) == 1
    assert one[0].matches == searched(cameras[0], cameras[1])[0].matches
    single = searched(cameras[0], cameras[1], options=replace(OPTIONS, n_candidates=1))
    assert len(single) == 1


def test_exchanging_the_cameras_changes_the_sign_of_the_lag(scene):
    _, cameras = scene
    there, back = searched(cameras[0], cameras[3])[0], searched(cameras[3], cameras[0])[0]
    assert there.lag == pytest.approx(-back.lag, abs=0.02)
    assert set(there.matches) == {(p, q) for q, p in back.matches}


@pytest.mark.parametrize(("length", "frames"), [(30, 0.05), (20, 0.05), (16, 1.0)])
def test_fragments_of_tracks_add_up(scene, length, frames):
    """Each camera's ids change every so many frames, at different times."""
    made, cameras = scene

    def cut(camera, begin):
        edges = [0, *range(begin, 80, length), 80]
        parts = [
            (p, track[(track.frames >= first) & (track.frames < last)])
            for p, track in enumerate(camera.tracks)
            for first, last in pairwise(edges)
        ]
        whole, tracks = zip(*parts, strict=True)
        return replace(camera, tracks=tracks), whole

    (a, whole_a), (b, whole_b) = cut(cameras[0], 9), cut(cameras[1], 14)
    best = searched(a, b)[0]
    of_tracks = {(whole_a[p], whole_b[q]) for p, q in best.matches}
    truth = true_pair(made, 0, 1)
    assert_found(replace(best, matches=tuple(of_tracks)), truth, frames=frames, rad=0.05)
    # Most of what the whole tracks have in common.
    assert best.points > 0.8 * searched(cameras[0], cameras[1])[0].points


def test_a_track_is_not_two_people_at_one_time(scene):
    _, cameras = scene
    doubled = replace(cameras[1], tracks=(*cameras[1].tracks, *cameras[1].tracks))
    best = searched(cameras[0], doubled)[0]
    p, q = zip(*best.matches, strict=True)
    assert len(set(p)) == len(p) == 3
    assert len(set(q)) == 3


def test_one_person_is_enough(scene):
    made, cameras = scene
    truth = true_pair(made, 0, 1)
    one = [replace(c, tracks=c.tracks[:1]) for c in cameras[:2]]
    best = searched(*one)[0]
    assert_found(best, replace(truth, matches=((0, 0),)), frames=0.2, rad=0.1)


def test_half_of_the_joints_in_common_are_enough(scene, rng):
    made, cameras = scene

    def thinned(track):
        x = track.x.copy()
        x[rng.uniform(size=x.shape[:2]) < 0.3] = np.nan
        return replace(track, x=x)

    a, b = (replace(c, tracks=tuple(thinned(t) for t in c.tracks)) for c in cameras[:2])
    assert_found(searched(a, b)[0], true_pair(made, 0, 1), frames=0.1, rad=0.03)


def test_cameras_that_have_nobody_in_common_agree_on_little(scene, strangers):
    _, cameras = scene
    right = searched(cameras[0], cameras[1])[0]
    for other in strangers[:2]:
        wrong = searched(cameras[0], other)[0]
        assert wrong.error_px > 3 * right.error_px
        assert wrong.support < 0.4 * right.support


def test_with_one_clock_the_lag_is_zero():
    made = simulate(ONE_CLOCK)
    cameras = lifted(made.recording)[1]
    found = searched(cameras[0], cameras[1], max_lag=0)
    assert {one.lag for one in found} == {0.0}
    assert_found(found[0], true_pair(made, 0, 1))


def test_a_lag_beyond_the_range_is_not_found(scene):
    made, cameras = scene
    assert true_pair(made, 0, 2).lag_s < -3 * FRAME_S
    within = searched(cameras[0], cameras[2])[0]
    beyond = searched(cameras[0], cameras[2], max_lag=2)
    assert all(abs(one.lag) <= 2 for one in beyond)
    assert all(one.error_px > 3 * within.error_px for one in beyond)


def test_a_wide_range_finds_the_same(scene):
    _, cameras = scene
    near, far = (searched(cameras[0], cameras[1], max_lag=n)[0] for n in (30, 2000))
    assert far.lag == pytest.approx(near.lag, abs=1e-6)
    assert set(far.matches) == set(near.matches)


def test_cameras_without_tracks_have_no_agreement(scene):
    _, cameras = scene
    empty = replace(cameras[1], tracks=())
    assert searched(cameras[0], empty) == searched(empty, cameras[0]) == ()
    short = replace(cameras[1], tracks=tuple(track[:1] for track in cameras[1].tracks))
    assert searched(cameras[0], short) == ()
