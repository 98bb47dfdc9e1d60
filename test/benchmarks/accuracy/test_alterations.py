"""Poorer pose estimators and trackers: what is removed, and that the truth follows."""

from itertools import pairwise

import numpy as np
import pytest

from benchmarks.accuracy.alterations import (
    MISSING_JOINTS,
    TRACK_FRAMES,
    cut_tracks,
    without_half_of_joints,
)
from stcalib_ros.core.synthetic import SceneOptions, simulate


@pytest.fixture(scope="module")
def scene():
    return simulate(SceneOptions(n_cameras=2, n_people=2, n_frames=70, seed=5))


def tracks(scene):
    return [track for camera in scene.recording.cameras for track in camera.tracks]


def test_half_of_the_joints_are_missing_in_every_image(scene):
    for before, after in zip(tracks(scene), tracks(without_half_of_joints(scene)), strict=True):
        kept = np.isfinite(after.keypoints[..., 0])
        J = kept.shape[1]
        n_seen = np.isfinite(before.keypoints[..., 0])
        assert (kept <= n_seen).all()
        assert kept[n_seen.all(1)].sum(1) == pytest.approx(J - np.ceil(MISSING_JOINTS * J))
        np.testing.assert_array_equal(after.keypoints[kept], before.keypoints[kept])
        assert np.isnan(after.joints[~kept]).all()
        assert (after.scores[~kept] == 0).all()


def test_the_same_joints_are_missing_again(scene):
    for a, b in zip(
        tracks(without_half_of_joints(scene)), tracks(without_half_of_joints(scene)), strict=True
    ):
        np.testing.assert_array_equal(a.keypoints, b.keypoints)


def test_tracks_are_cut_and_nothing_is_lost(scene):
    cut = cut_tracks(scene)
    for before, after in zip(scene.recording.cameras, cut.recording.cameras, strict=True):
        ids = [track.track_id for track in after.tracks]
        assert len(set(ids)) == len(ids)
        assert all(np.ptp(track.frames) < TRACK_FRAMES for track in after.tracks)
        assert all((np.diff(track.frames) > 0).all() for track in after.tracks)
        for name in ("keypoints", "joints", "scores", "frames"):
            whole, pieces = (
                np.concatenate([getattr(track, name) for track in camera.tracks])
                for camera in (before, after)
            )
            np.testing.assert_array_equal(whole, pieces)


def test_the_truth_knows_the_pieces(scene):
    cut = cut_tracks(scene)
    for before, after in zip(scene.truth.persons, cut.truth.persons, strict=True):
        for camera, old, new in zip(
            scene.recording.cameras, before.tracks.values(), after.tracks.values(), strict=True
        ):
            length = sum(len(t.frames) for t in camera.tracks if t.track_id in old)
            pieces = next(c for c in cut.recording.cameras if c.name == camera.name).tracks
            own = [t for t in pieces if t.track_id in new]
            assert len(own) == len(new)
            assert sum(len(t.frames) for t in own) == length
            assert all(a.frames[-1] < b.frames[0] for a, b in pairwise(own)) or len(old) > 1
