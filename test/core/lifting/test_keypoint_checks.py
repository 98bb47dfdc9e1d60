"""Keypoints in other units, all at one place, or too few for their layout."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import changed, every, lifted, tracks_changed
from hypothesis import given
from hypothesis import strategies as st

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.lifting.keypoint_checks import (
    at_one_place,
    keypoint_faults,
    keypoint_remarks,
    require_shapes,
    without_people,
)
from stcalib_ros.core.model.recording import keypoints_only
from stcalib_ros.core.model.rejection import RejectionReason, RemarkCode

SIZE = np.array([1920.0, 1080.0])


def faults(recording):
    return {name: one.reason for name, one in keypoint_faults(recording, min_score=0.3).items()}


def normalised(track):
    return replace(track, keypoints=track.keypoints / SIZE)


def centred(track):
    return replace(track, keypoints=2 * track.keypoints / SIZE - 1)


def collapsed(track, rows=slice(None), place=(400.0, 300.0)):
    keypoints = track.keypoints.copy()
    keypoints[rows] = place
    return replace(track, keypoints=keypoints)


def test_keypoints_of_people_have_no_fault(small_scene):
    assert faults(small_scene.recording) == {}
    assert faults(keypoints_only(small_scene.recording)) == {}
    assert keypoint_remarks(small_scene.recording, min_score=0.3) == ()


@pytest.mark.parametrize(("change", "least"), [(normalised, 0.0), (centred, -1.0)])
def test_normalised_keypoints_are_recognised(small_scene, change, least):
    recording = changed(small_scene.recording, "cam1", tracks_changed(change))
    assert faults(recording) == {"cam1": RejectionReason.KEYPOINTS_NORMALISED}
    found = keypoint_faults(recording, min_score=0.3)["cam1"]
    assert least - 0.1 < found.values["least"] < found.measured < 1.1
    assert (found.values["width"], found.values["height"]) == (1920, 1080)


@pytest.mark.parametrize("place", [(0.0, 0.0), (1.0, 1.0), (400.0, 300.0)])
def test_a_camera_with_all_keypoints_at_one_place_is_no_use(small_scene, place):
    recording = changed(
        small_scene.recording, "cam2", tracks_changed(lambda t: collapsed(t, place=place))
    )
    assert faults(recording) == {"cam2": RejectionReason.KEYPOINTS_COINCIDE}
    assert keypoint_remarks(recording, min_score=0.3) == ()
    _, cameras = lifted(recording)
    assert [len(camera.tracks) > 0 for camera in cameras] == [True, True, False]


def test_single_poses_at_one_place_are_left_out_and_counted(small_scene):
    recording = changed(
        small_scene.recording, "cam2", tracks_changed(lambda t: collapsed(t, slice(10, 15)))
    )
    assert faults(recording) == {}
    (remark,) = keypoint_remarks(recording, min_score=0.3)
    camera = recording.cameras[2]
    assert (remark.code, remark.cameras) == (RemarkCode.POSES_LEFT_OUT, ("cam2",))
    assert remark.values["n_left_out"] == 5 * len(camera.tracks)
    _, cameras = lifted(recording)
    for given_track, track in zip(camera.tracks, cameras[2].tracks, strict=True):
        assert not np.isin(given_track.frames[10:15], track.frames).any()


def test_keypoints_below_the_score_are_not_looked_at(small_scene):
    def undetected(track):
        """As estimators have it that give zeros for what they did not detect."""
        track = collapsed(track, slice(5), place=(0.0, 0.0))
        scores = track.scores.copy()
        scores[:5] = 0.0
        return replace(track, scores=scores)

    recording = every(small_scene.recording, tracks_changed(undetected))
    assert faults(recording) == {}
    assert keypoint_remarks(recording, min_score=0.3) == ()


def test_nobody_has_no_fault(small_scene):
    recording = without_people(small_scene.recording, {"cam1": None})
    assert [len(camera.tracks) > 0 for camera in recording.cameras] == [True, False, True]
    assert faults(recording) == {}
    assert at_one_place(np.zeros((0, 17, 2))).tolist() == []


@given(
    place=st.tuples(*2 * [st.floats(-1e4, 1e4, width=32)]),
    spread=st.floats(0.0, 50.0),
    n_observed=st.integers(0, 17),
)
def test_a_pose_within_a_pixel_is_at_one_place(place, spread, n_observed):
    pose = np.full((1, 17, 2), np.nan)
    pose[0, :n_observed] = np.array(place) + np.linspace(0, spread, n_observed)[:, None]
    extent = np.ptp(pose[0, :n_observed, 0]) if n_observed else np.nan
    assert at_one_place(pose).tolist() == [bool(n_observed > 1 and extent <= 1.0)]


@pytest.mark.parametrize(
    ("name", "shape", "text"),
    [
        ("keypoints", (80, 16, 2), r"keypoints has shape \(80, 16, 2\), but 80 frames .*17, 2"),
        ("joints", (80, 0, 3), r"joints has shape \(80, 0, 3\), but .*\(80, 17, 3\)"),
        ("scores", (79, 17), r"scores has shape \(79, 17\), but .*\(80, 17\)"),
    ],
)
def test_arrays_that_do_not_fit_the_layout_are_refused(exact_scene, name, shape, text):
    first = exact_scene.recording.cameras[0].tracks[0].track_id

    def cut(track):
        return replace(track, **{name: np.zeros(shape)}) if track.track_id == first else track

    recording = changed(exact_scene.recording, "cam0", tracks_changed(cut))
    with pytest.raises(InputError, match=f"camera cam0, track {first}: {text}"):
        require_shapes(recording)
