"""Stamps that come in bunches, clocks that are set, and times that nobody shares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import stcalib_ros as st
from stcalib_ros.core.geometry.interpolation import frame_period, mean_period
from stcalib_ros.core.lifting.time_base import TimeBase, mended_time_base
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.core.model.rejection import RejectionReason, RemarkCode

FPS = 30.0
SCENE = st.simulate(st.SceneOptions(n_cameras=3, n_people=2, n_frames=150, fps=FPS, seed=4))
OPTIONS = st.Options()


def bunched(stamps: Float64Array, n: int, gap_s: float) -> Float64Array:
    """Stamps of arrival, where a buffer lets n images go at once."""
    k = np.arange(len(stamps))
    last = np.minimum(k // n * n + n - 1, len(stamps) - 1)
    return np.asarray(stamps[last] + 0.04 + k % n * gap_s)


def of_images(camera: CameraRecording, kept: BoolArray) -> CameraRecording:
    """Some images of a camera only."""
    number = np.cumsum(kept) - 1
    tracks = []
    for track in camera.tracks:
        rows = kept[track.frames]
        values = {n: getattr(track, n)[rows] for n in ("keypoints", "joints", "scores")}
        tracks.append(replace(track, frames=number[track.frames[rows]], **values))
    return replace(
        camera, stamps=camera.stamps[kept], tracks=tuple(t for t in tracks if len(t.frames))
    )


def with_camera(c: int, camera: CameraRecording) -> Recording:
    cameras = list(SCENE.recording.cameras)
    cameras[c] = camera
    return replace(SCENE.recording, cameras=tuple(cameras))


def with_stamps(c: int, stamps: Float64Array) -> Recording:
    return with_camera(c, replace(SCENE.recording.cameras[c], stamps=stamps))


def mended(recording: Recording) -> TimeBase:
    return mended_time_base(recording, OPTIONS)


@pytest.mark.parametrize("camera", [0, 2])
@pytest.mark.parametrize(
    ("n", "gap_s"), [(2, 0.012), (2, 1e-6), (3, 5e-4), (5, 2e-3), (10, 1e-6), (10, 0.003)]
)
def test_bunches_are_made_even(camera: int, n: int, gap_s: float) -> None:
    true = SCENE.recording.cameras[camera].stamps
    given = bunched(true, n, gap_s)
    found = mended(with_stamps(camera, given))
    assert not found.faults
    (remark,) = found.remarks
    assert remark.code is RemarkCode.STAMPS_EVENED
    assert remark.cameras == (SCENE.recording.cameras[camera].name,)
    assert remark.values["bunch"] == n
    stamps = found.recording.cameras[camera].stamps
    late = stamps - true
    assert np.ptp(late) < 0.2 / FPS  # the last bunch may be incomplete
    assert abs(np.mean(stamps - given)) < 1e-9
    for k, other in enumerate(SCENE.recording.cameras):
        if k != camera:
            assert found.recording.cameras[k] is other


def test_a_buffer_that_is_held_up_now_and_then() -> None:
    true = SCENE.recording.cameras[1].stamps
    given = true.copy()
    for first in (40, 100):
        given[first : first + 9] = given[first + 9] - 1e-3 * np.arange(9, 0, -1)
    found = mended(with_stamps(1, given))
    assert [r.code for r in found.remarks] == [RemarkCode.STAMPS_EVENED]
    late = found.recording.cameras[1].stamps - true
    assert np.ptp(late) < 0.5 / FPS < 3.0 * np.std(given - true)


def test_recordings_of_cameras_that_pause_or_lose_images_stay_as_they_are() -> None:
    rng = np.random.default_rng(1)
    camera = SCENE.recording.cameras[1]
    k = np.arange(len(camera.stamps))
    for kept in (rng.random(len(k)) > 0.5, k % 15 < 5, k % 40 < 12, (k // 2) % 3 == 0):
        recording = with_camera(1, of_images(camera, np.asarray(kept)))
        found = mended(recording)
        assert not found.faults
        assert not found.remarks
        assert found.recording.cameras == recording.cameras


def test_images_that_are_sent_twice_stay_where_they_are() -> None:
    camera = SCENE.recording.cameras[1]
    twice = np.repeat(np.arange(len(camera.stamps)), 2)
    stamps = camera.stamps[twice] + 1e-4 * (np.arange(len(twice)) % 2)
    tracks = []
    for track in camera.tracks:
        rows = np.repeat(np.arange(len(track.frames)), 2)
        frames = 2 * track.frames[rows] + np.arange(len(rows)) % 2
        values = {n: getattr(track, n)[rows] for n in ("keypoints", "joints", "scores")}
        tracks.append(replace(track, frames=frames, **values))
    found = mended(with_camera(1, replace(camera, stamps=stamps, tracks=tuple(tracks))))
    assert not found.faults
    assert not found.remarks
    assert found.recording.cameras[1].stamps is stamps


@pytest.mark.parametrize("jitter_s", [0.0, 2e-3, 6e-3])
def test_usual_stamps_stay_as_they_are(jitter_s: float) -> None:
    rng = np.random.default_rng(2)
    stamps = SCENE.recording.cameras[1].stamps
    stamps = np.sort(stamps + rng.normal(0.0, jitter_s, len(stamps)))
    found = mended(with_stamps(1, stamps))
    assert not found.faults
    assert not found.remarks
    assert found.recording.cameras[1].stamps is stamps


def test_bunches_that_lose_images_are_refused_with_the_camera() -> None:
    camera = SCENE.recording.cameras[1]
    kept = np.random.default_rng(3).random(len(camera.stamps)) > 0.2
    part = of_images(camera, kept)
    found = mended(with_camera(1, replace(part, stamps=bunched(part.stamps, 3, 5e-4))))
    assert {n: f.reason for n, f in found.faults.items()} == {
        camera.name: RejectionReason.STAMPS_IN_BUNCHES
    }
    fault = found.faults[camera.name]
    assert 0.6 < fault.measured < 0.7
    assert fault.values["bunch"] == 3


def test_stamps_in_another_unit_are_refused_with_the_camera() -> None:
    stamps = SCENE.recording.cameras[1].stamps
    found = mended(with_stamps(1, stamps[0] + 1e-6 * (stamps - stamps[0])))
    assert {n: f.reason for n, f in found.faults.items()} == {
        "cam1": RejectionReason.STAMPS_TOO_CLOSE
    }


@pytest.mark.parametrize("jump_s", [1e4, 1e5, 1.76e9])
@pytest.mark.parametrize("camera", [0, 1])
def test_a_clock_that_is_set_loses_the_images_that_nobody_can_share(
    jump_s: float, camera: int
) -> None:
    stamps = SCENE.recording.cameras[camera].stamps
    k = np.arange(len(stamps))
    found = mended(with_stamps(camera, np.where(k < 60, stamps - jump_s, stamps)))
    (remark,) = found.remarks
    assert remark.code is RemarkCode.IMAGES_LEFT_OUT
    assert remark.values == {"n_left_out": 60, "n_images": len(stamps)}
    mine = found.recording.cameras[camera]
    np.testing.assert_array_equal(mine.stamps, stamps[60:])
    before = of_images(SCENE.recording.cameras[camera], k >= 60)
    for one, other in zip(mine.tracks, before.tracks, strict=True):
        np.testing.assert_array_equal(one.frames, other.frames)
        np.testing.assert_array_equal(one.keypoints, other.keypoints)


def test_of_clips_that_are_days_apart_the_fullest_is_taken() -> None:
    cameras = []
    for camera in SCENE.recording.cameras:
        k = np.arange(len(camera.stamps))
        cameras.append(replace(camera, stamps=camera.stamps + 1e5 * (k >= 40) + 1e5 * (k >= 120)))
    found = mended(replace(SCENE.recording, cameras=tuple(cameras)))
    assert [len(c.stamps) for c in found.recording.cameras] == [80, 80, 80]
    assert {r.code for r in found.remarks} == {RemarkCode.IMAGES_LEFT_OUT}


def test_clips_that_are_minutes_apart_stay_together() -> None:
    cameras = []
    for camera in SCENE.recording.cameras:
        k = np.arange(len(camera.stamps))
        cameras.append(replace(camera, stamps=camera.stamps + 120.0 * (k >= 70)))
    recording = replace(SCENE.recording, cameras=tuple(cameras))
    assert mended(recording).recording.cameras == recording.cameras


@pytest.mark.parametrize("n", [2, 3, 7])
def test_the_period_is_known_from_all_of_the_clip(n: int) -> None:
    stamps = np.arange(300) / FPS
    assert frame_period(stamps) == pytest.approx(1.0 / FPS)
    assert frame_period(bunched(stamps, n, 1e-4)) == pytest.approx(1.0 / FPS, rel=0.15)
    assert mean_period(np.where(np.arange(300) > 200, stamps + 1e5, stamps)) == pytest.approx(
        1.0 / FPS
    )
    lost = stamps[np.random.default_rng(0).random(300) > 0.4]
    assert frame_period(lost) == pytest.approx(1.0 / FPS)
    assert frame_period(stamps[:1]) == mean_period(stamps[:0]) == float("inf")


def test_bunches_are_calibrated_and_said() -> None:
    scene = st.simulate(st.SceneOptions(n_cameras=3, n_people=2, n_frames=240, seed=5))
    cameras = tuple(
        replace(c, stamps=bunched(c.stamps, 3, 5e-4)) if c.name == "cam1" else c
        for c in scene.recording.cameras
    )
    result = st.calibrate(replace(scene.recording, cameras=cameras))
    assert result.status is st.Status.OK, result.message
    assert RemarkCode.STAMPS_EVENED in {r.code for r in result.remarks}
    assert st.evaluate(result, scene.truth).E_R < 0.01
