"""The people of an adjustment as a camera without errors would have them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stcalib_ros.core.bundle.limits import NEAREST
from stcalib_ros.core.bundle.state import person_rows_of
from stcalib_ros.core.reconstruction import people
from stcalib_ros.core.reconstruction.limits import WIDEST_VIEW
from stcalib_ros.core.reconstruction.people import people_as_observed


@pytest.fixture(scope="module")
def last(small_stages):
    return small_stages.iterations[-1]


@pytest.mark.parametrize("c", range(3))
def test_its_keypoints_are_projections_of_the_joints(last, c):
    obs, state = last.observations, last.state
    seen = people_as_observed(last, c)
    parts = list(person_rows_of(obs))
    assert len(seen.tracks) == len(parts) == 2
    for part, track in zip(parts, seen.tracks, strict=True):
        for n in range(part.start, part.stop, 7):
            (k,) = np.flatnonzero(track.frames == obs.time_bin[n])
            known = state.inlier[n].sum(0) >= 2
            X = state.X[n][known] @ state.R_cam_ref[c].T + state.t_cam_ref[c]
            np.testing.assert_allclose(track.x[k][known], X[:, :2] / X[:, 2:], rtol=1e-6)
            np.testing.assert_allclose(track.joints_cam[k][known], X, rtol=1e-6)
            np.testing.assert_allclose(track.root_cam[k], X.mean(0), rtol=1e-6)
            assert np.isnan(track.x[k][~known]).all()


@pytest.mark.parametrize("c", range(3))
def test_they_are_where_the_camera_observes_them(last, c):
    """Within the noise, at the times of the images."""
    obs = last.observations
    seen = people_as_observed(last, c)
    errors = []
    for part, track in zip(person_rows_of(obs), seen.tracks, strict=True):
        own = obs.observed[part, c] & (np.abs(obs.phi[part, c]) < 0.2 * obs.step_s)[:, None]
        rows = np.searchsorted(track.frames, obs.time_bin[part])
        off = (track.x[rows] - obs.x[part, c]) * obs.focal[part, c][..., None]
        errors.append(np.linalg.norm(off, axis=-1)[own])
    errors = np.concatenate(errors)
    assert np.isfinite(errors).sum() > 100
    assert np.nanmedian(errors) < 6


def test_it_has_an_image_at_every_time_bin_by_the_reference_clock(last):
    obs = last.observations
    seen = people_as_observed(last, 1)
    np.testing.assert_allclose(np.diff(seen.stamps), obs.step_s)
    assert seen.stamps[0] == obs.start_s
    assert len(seen.stamps) == obs.time_bin.max() + 1
    for track in seen.tracks:
        assert (np.diff(track.frames) == 1).all()
        assert track.x.shape == (*track.focal.shape, 2) == (*track.joints_cam.shape[:2], 2)
        assert np.ptp(track.focal) == 0


def turned(last, c, A):
    """The camera looks elsewhere, from the same place."""
    R, t = last.state.R_cam_ref.copy(), last.state.t_cam_ref.copy()
    R[c], t[c] = A @ R[c], A @ t[c]
    return replace(last, state=replace(last.state, R_cam_ref=R, t_cam_ref=t))


def test_people_behind_the_camera_are_not_seen(last):
    for track in people_as_observed(turned(last, 1, np.diag([-1.0, 1.0, -1.0])), 1).tracks:
        assert np.isnan(track.x).all()
        assert np.isfinite(track.root_cam).any()


@pytest.mark.parametrize("degrees", [55, 62, 68, 80])
def test_people_far_beside_its_axis_are_not_seen(last, degrees):
    away = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    for track in people_as_observed(turned(last, 1, away), 1).tracks:
        X = track.joints_cam
        beside = np.abs(X[..., :2] / X[..., 2:]).max(-1)
        seen = (X[..., 2] > NEAREST) & (beside <= WIDEST_VIEW)
        np.testing.assert_array_equal(np.isfinite(track.x[..., 0]), seen)


def test_those_observed_longest_are_kept(last, monkeypatch):
    monkeypatch.setattr(people, "MAX_PEOPLE", 1)
    lengths = [part.stop - part.start for part in person_rows_of(last.observations)]
    (track,) = people_as_observed(last, 0).tracks
    longest = int(np.argmax(lengths))
    part = list(person_rows_of(last.observations))[longest]
    assert track.frames[0] == last.observations.time_bin[part.start]
    assert track.frames[-1] == last.observations.time_bin[part.stop - 1]
