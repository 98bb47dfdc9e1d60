"""Every image at the time bin nearest to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import EXACT, lifted, true_rig
from hypothesis import given
from hypothesis import strategies as st

from stcalib_ros.core.bundle.observations import nearest_bins, observe
from stcalib_ros.core.geometry.interpolation import frame_period
from stcalib_ros.core.integration.association import associate
from stcalib_ros.core.registration.resampling import common_step
from stcalib_ros.core.synthetic import simulate


@pytest.fixture(scope="module", params=["one rate", "mixed rates, jitter and drops"])
def observed(request):
    options = replace(EXACT, n_frames=100, max_offset_frames=6, sigma_px=1.0, missing=0.1)
    if request.param != "one rate":
        options = replace(
            options, fps=(30.0, 60.0, 25.0, 30.0), stamp_jitter_s=0.004, drop_rate=0.1
        )
    scene = simulate(options)
    _, cameras = lifted(scene.recording)
    rig, step_s = true_rig(scene), common_step(cameras)
    association = associate(cameras, rig, step_s=step_s, floor_px=8.0)
    return cameras, rig, association, observe(cameras, rig, association, step_s=step_s)


def frames_of(observed, c):
    """Rows at which camera c takes part, the index of the image each time, and its track."""
    cameras, rig, _, o = observed
    rows = np.flatnonzero(o.track[:, c] >= 0)
    times = o.start_s + o.time_bin[rows] * o.step_s + o.phi[rows, c] - rig.offset_s[c]
    frames = np.abs(cameras[c].stamps - times[:, None]).argmin(1)
    np.testing.assert_allclose(cameras[c].stamps[frames], times, atol=1e-9)
    return rows, frames, o.track[rows, c]


def test_images_are_within_half_a_step_of_their_knot_or_little_more(observed):
    o = observed[-1]
    away = np.abs(o.phi[o.track >= 0])
    assert away.max() < 0.75 * o.step_s
    assert (away <= o.step_s / 2 + 1e-12).mean() > 0.95
    assert not o.phi[o.track < 0].any()


def test_without_jitter_the_knot_is_the_nearest():
    position = np.arange(40) + 0.49
    np.testing.assert_array_equal(nearest_bins(position), np.arange(40))
    twice = np.arange(0, 40, 0.5) + 0.2
    np.testing.assert_array_equal(nearest_bins(twice), np.rint(twice))


def test_an_image_gives_way_to_another_if_the_knot_beside_it_has_none():
    position = np.array([0.0, 1.6, 2.4, 3.6, 4.45, 6.6, 7.3, 8.0])
    np.testing.assert_array_equal(nearest_bins(position), [0, 1, 2, 3, 4, 6, 7, 8])
    # Too far from the free time bin; and a later one that moves on.
    np.testing.assert_array_equal(nearest_bins(np.array([2.1, 2.2, 3.0])), [2, 2, 3])
    np.testing.assert_array_equal(nearest_bins(np.array([1.0, 2.1, 2.4])), [1, 2, 3])


@given(st.integers(0, 2**32 - 1), st.floats(-0.5, 0.5), st.floats(0.0, 0.25), st.floats(0.0, 0.3))
def test_images_with_jitter_lose_fewer_knots(seed, shift, jitter, lost):
    rng = np.random.default_rng(seed)
    position = np.arange(200) + shift + np.clip(rng.normal(0.0, jitter, 200), -0.49, 0.49)
    position = np.sort(position[rng.uniform(size=200) >= lost])
    time_bin, nearest = nearest_bins(position), np.rint(position)
    assert len(np.unique(time_bin)) >= len(np.unique(nearest))
    assert (np.diff(time_bin) >= 0).all()
    moved = np.flatnonzero(time_bin != nearest)
    assert (np.abs(position - time_bin)[moved] < 0.75).all()
    shared = np.bincount((nearest + 1).astype(int))[(nearest[moved] + 1).astype(int)]
    assert (shared > 1).all()


def test_no_image_is_used_twice(observed):
    for c in range(4):
        _, frames, track = frames_of(observed, c)
        used = np.stack([frames, track], -1)
        assert len(np.unique(used, axis=0)) == len(used)


def test_every_row_has_two_cameras(observed):
    o = observed[-1]
    assert ((o.track >= 0).sum(1) >= 2).all()


def test_rows_are_sorted_by_person_and_knot_and_unique(observed):
    o = observed[-1]
    key = np.stack([o.person, o.time_bin], -1)
    np.testing.assert_array_equal(np.unique(key, axis=0), key)


def test_points_are_those_of_the_image(observed):
    cameras, _, _, o = observed
    for c in range(4):
        rows, frames, track = frames_of(observed, c)
        for row, frame, p in zip(rows[::17], frames[::17], track[::17], strict=True):
            source = cameras[c].tracks[p]
            at = np.flatnonzero(source.frames == frame)[0]
            known = np.isfinite(source.x[at]).all(-1)
            np.testing.assert_array_equal(o.observed[row, c], known)
            np.testing.assert_array_equal(o.x[row, c][known], source.x[at][known])
            np.testing.assert_array_equal(o.focal[row, c][known], source.focal[at][known])
            assert not o.x[row, c][~known].any()


def test_the_person_is_that_of_the_track_at_that_time(observed):
    cameras, rig, association, o = observed
    for c in range(4):
        rows, frames, track = frames_of(observed, c)
        slot = association.slot(cameras[c].stamps[frames] + rig.offset_s[c])
        np.testing.assert_array_equal(association.person_of[c][track, slot], o.person[rows])


def test_where_a_camera_has_no_image_nothing_is_seen(observed):
    o = observed[-1]
    assert not o.observed[o.track < 0].any()
    assert np.isfinite(o.x).all()
    assert np.isfinite(o.focal).all()


def test_of_two_images_near_a_knot_the_nearer_is_taken(observed):
    cameras, rig, association, o = observed
    row_of = {key: n for n, key in enumerate(zip(o.person, o.time_bin, strict=True))}
    rivals = 0
    for c, camera in enumerate(cameras):
        for p, track in enumerate(camera.tracks):
            times = camera.stamps[track.frames] + rig.offset_s[c]
            person = association.person_of[c][p, association.slot(times)]
            elapsed = times - o.start_s
            own = nearest_bins((camera.stamps + rig.offset_s[c] - o.start_s) / o.step_s)
            time_bin = own[track.frames]
            away = np.abs(elapsed - time_bin * o.step_s)
            for key, phi in zip(zip(person, time_bin, strict=True), away, strict=True):
                if key in row_of:
                    taken = abs(o.phi[row_of[key], c])
                    assert taken <= phi + 1e-12
                    rivals += taken < phi - 1e-12
    assert rivals > 0 or len({round(1e4 * np.diff(c.stamps).max()) for c in cameras}) == 1


def test_hardly_an_image_is_lost(observed):
    cameras, _, _, o = observed
    for c, camera in enumerate(cameras):
        images = sum(len(t.frames) for t in camera.tracks)
        # Lost are those that no other camera sees at that moment, and every other one of the
        # camera that is twice as fast as the time bins.
        every = max(1.0, o.step_s / frame_period(camera.stamps))
        assert (o.track[:, c] >= 0).sum() > 0.8 * images / every


def test_every_nth_joint_keeps_the_rows(observed):
    o = observed[-1]
    thin = o.thinned_joints(4)
    np.testing.assert_array_equal(thin.x, o.x[:, :, [0, 4, 8, 12, 16]])
    np.testing.assert_array_equal(thin.focal, o.focal[:, :, [0, 4, 8, 12, 16]])
    np.testing.assert_array_equal(thin.observed, o.observed[:, :, [0, 4, 8, 12, 16]])
    np.testing.assert_array_equal(thin.phi, o.phi)
