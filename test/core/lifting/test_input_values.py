"""Scores in another range, keypoints that were not detected, images that repeat."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import tracks_changed

from stcalib_ros.core.lifting.input_values import (
    with_scores_of_one,
    without_repeated_images,
    without_undetected,
)
from stcalib_ros.core.model.recording import Track
from stcalib_ros.core.model.rejection import RejectionReason, RemarkCode

LIMIT = 0.3


@pytest.fixture(scope="module")
def camera(small_scene):
    return small_scene.recording.cameras[1]


def scored(factor):
    return tracks_changed(lambda track: replace(track, scores=factor * track.scores))


def at(place, share):
    """Some keypoints, of all joints, at one place."""

    def change(track):
        keypoints = track.keypoints.copy()
        keypoints[np.random.default_rng(0).random(track.scores.shape) < share] = place
        return replace(track, keypoints=keypoints)

    return tracks_changed(change)


def test_sound_input_is_left_alone(camera):
    for step in (with_scores_of_one, without_undetected, without_repeated_images):
        read = step(camera, min_score=LIMIT)
        assert (read.camera, read.remarks, read.fault) == (camera, (), None)
        nobody = replace(camera, tracks=())
        assert step(nobody, min_score=LIMIT).camera is nobody


def test_scores_in_percent_are_divided(camera):
    read = with_scores_of_one(scored(100.0)(camera), min_score=LIMIT)
    (remark,) = read.remarks
    assert (remark.code, remark.cameras) == (RemarkCode.SCORES_IN_PERCENT, ("cam1",))
    assert 90.0 < remark.values["largest"] <= 100.0
    for before, after in zip(camera.tracks, read.camera.tracks, strict=True):
        np.testing.assert_allclose(after.scores, before.scores)


@pytest.mark.parametrize("factor", [1.05, 8.0, 255.0])
def test_other_scores_are_taken_as_they_are(camera, factor):
    assert with_scores_of_one(scored(factor)(camera), min_score=LIMIT).remarks == ()


def test_scores_below_the_limit_are_named(camera):
    read = with_scores_of_one(scored(0.2)(camera), min_score=LIMIT)
    assert read.fault.reason is RejectionReason.SCORES_BELOW_LIMIT
    assert 0.1 < read.fault.measured <= 0.2 < read.fault.limit == LIMIT


@pytest.mark.parametrize("place", [(0.0, 0.0), (-1.0, -1.0), (0.0, 540.0), (960.0, 540.0)])
def test_keypoints_at_one_place_were_not_detected(camera, place):
    wrong = at(place, 0.2)(camera)
    read = without_undetected(wrong, min_score=LIMIT)
    (remark,) = read.remarks
    assert (remark.code, remark.cameras) == (RemarkCode.KEYPOINTS_NOT_OBSERVED, ("cam1",))
    assert (remark.values["x"], remark.values["y"]) == place
    n = 0
    for before, after in zip(wrong.tracks, read.camera.tracks, strict=True):
        there = (before.keypoints == place).all(-1)
        n += (there & (before.scores >= LIMIT)).sum()
        lost = np.isnan(before.keypoints).all(-1)
        np.testing.assert_array_equal(np.isnan(after.keypoints).all(-1), there | lost)
    assert remark.values["n_points"] == n > 0


def test_of_keypoints_with_low_scores_nothing_is_said(camera):
    wrong = scored(0.0)(at((-1.0, -1.0), 0.2)(camera))
    read = without_undetected(wrong, min_score=LIMIT)
    assert read.remarks == ()
    assert np.isnan(read.camera.tracks[0].keypoints).any()


def test_whole_pixels_of_somebody_who_stands_are_observed(camera):
    def standing(track):
        first = np.rint(track.keypoints[:1] + np.arange(17)[:, None])
        return replace(track, keypoints=np.repeat(first, len(track.frames), axis=0))

    still = tracks_changed(standing)(camera)
    assert without_undetected(still, min_score=LIMIT).remarks == ()


def test_whoever_is_at_one_place_only_is_nobody(camera):
    nobody = at((400.0, 300.0), 1.0)(camera)
    assert without_undetected(nobody, min_score=LIMIT).remarks == ()


def shown(camera, image_of):
    """The camera with the picture of another image in every image."""

    def change(track):
        rows = image_of(track.frames)
        arrays = (getattr(track, name)[rows] for name in ("keypoints", "joints", "scores"))
        return Track(track.track_id, track.frames, *arrays)

    return tracks_changed(change)(camera)


def test_images_that_repeat_are_left_out(camera):
    twice = shown(camera, lambda frames: frames // 2 * 2)
    read = without_repeated_images(twice, min_score=LIMIT)
    (remark,) = read.remarks
    assert (remark.code, remark.cameras) == (RemarkCode.IMAGES_REPEATED, ("cam1",))
    assert (remark.values["n_repeated"], remark.values["n_images"]) == (40, 80)
    np.testing.assert_array_equal(read.camera.stamps, camera.stamps[::2])
    for before, after in zip(camera.tracks, read.camera.tracks, strict=True):
        np.testing.assert_array_equal(after.frames, np.arange(40))
        np.testing.assert_array_equal(after.keypoints, before.keypoints[::2])


def test_a_stream_that_freezes_ends_there(camera):
    frozen = shown(camera, lambda frames: np.minimum(frames, 29))
    read = without_repeated_images(frozen, min_score=LIMIT)
    (remark,) = read.remarks
    assert remark.values["longest_s"] == pytest.approx(camera.stamps[79] - camera.stamps[29])
    assert [len(track.frames) for track in read.camera.tracks] == 2 * [30]


def test_one_who_stands_still_to_the_bit_repeats_no_image(camera):
    first, *others = camera.tracks
    still = replace(first, keypoints=np.repeat(first.keypoints[:1], 80, axis=0))
    both = replace(camera, tracks=(still, *others))
    assert without_repeated_images(both, min_score=LIMIT).camera is both


def test_a_picture_that_stands_still_is_named(camera):
    read = without_repeated_images(
        shown(camera, lambda frames: np.minimum(frames, 2)), min_score=LIMIT
    )
    assert read.fault.reason is RejectionReason.STREAM_FROZEN
    assert read.fault.measured == pytest.approx(77 / 80)
