"""What is said of a recording before it is calibrated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import HALF_SECOND, SMALL, changed, clock_shifted, tracks_changed

from stcalib_ros.core.diagnosis.advice import AdviceCode, advise
from stcalib_ros.core.diagnosis.examine import MIN_EXPLAINED, Diagnosis, PairFacts, examine
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.recording import CameraRecording, Recording, keypoints_only, only_images
from stcalib_ros.core.model.rejection import RejectionReason, RemarkCode
from stcalib_ros.core.synthetic import Scene, simulate


@pytest.fixture(scope="module")
def scene() -> Scene:
    return simulate(replace(SMALL, n_frames=150))


@pytest.fixture(scope="module")
def good(scene: Scene) -> Diagnosis:
    return examine(scene.recording, HALF_SECOND)


def codes(found: Diagnosis) -> set[AdviceCode]:
    return {one.code for one in advise(found)}


def test_a_good_recording_will_calibrate(good: Diagnosis) -> None:
    assert good.will_calibrate
    assert good.calibrated == ("cam0", "cam1", "cam2")
    assert (good.reasons, good.unusable, good.doubtful) == ((), "", ())
    assert len(good.pairs) == 3
    assert min(fit.explained for fit in good.fits.values()) > 0.85


def test_of_many_images_a_part_says_the_same(
    scene: Scene, good: Diagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stcalib_ros.core.diagnosis.examine.ENOUGH_IMAGES", 50)
    found = examine(scene.recording, HALF_SECOND)
    assert found.cameras == good.cameras
    assert (found.calibrated, found.doubtful) == (good.calibrated, ())
    assert found.pairs != good.pairs
    for pair, other in zip(found.pairs, good.pairs, strict=True):
        assert pair.shared_s == pytest.approx(other.shared_s, rel=0.1)
        assert pair.lag_s == pytest.approx(other.lag_s, abs=0.01)


def test_what_is_counted_is_what_was_recorded(scene: Scene, good: Diagnosis) -> None:
    for camera, facts in zip(scene.recording.cameras, good.cameras, strict=True):
        assert (facts.name, facts.n_images) == (camera.name, 150)
        assert facts.rate_hz == pytest.approx(30.0, rel=0.02)
        assert facts.end_s - facts.begin_s == pytest.approx(149 / 30, rel=0.02)
        assert facts.layout == "h36m_17"
        assert facts.lens is LensKnowledge.GIVEN
        assert facts.projection > 0.95
        n_poses = sum(len(track.frames) for track in camera.tracks)
        assert facts.persons == pytest.approx(n_poses / 150)


def test_the_clocks_of_two_cameras_are_as_far_apart_as_they_were(
    scene: Scene, good: Diagnosis
) -> None:
    offset_s = {c.name: c.time_offset_s for c in scene.truth.cameras}
    for pair in good.pairs:
        true_lag_s = offset_s[pair.camera_a] - offset_s[pair.camera_b]
        assert pair.lag_s == pytest.approx(true_lag_s, abs=0.02)
        assert pair.shared_s <= 2 * 150 / 30


def test_coverage_is_the_part_of_the_image_with_keypoints(scene: Scene) -> None:
    def to_the_left(keypoints: np.ndarray) -> np.ndarray:
        return np.where(np.isfinite(keypoints), [1.0, 1.0], np.nan)

    change = tracks_changed(lambda t: replace(t, keypoints=to_the_left(t.keypoints)))
    found = examine(changed(scene.recording, "cam1", change), HALF_SECOND)
    assert found.cameras[1].coverage == 1 / 64
    assert found.cameras[0].coverage > 0.2
    assert AdviceCode.COVER_MORE_IMAGE in codes(found)


def test_without_3d_poses_there_is_nothing_to_compare(scene: Scene) -> None:
    found = examine(keypoints_only(scene.recording, ["cam1"]), HALF_SECOND)
    assert np.isnan(found.cameras[1].projection)
    assert found.cameras[0].projection > 0.95
    assert found.will_calibrate


def test_one_camera_is_too_few(scene: Scene) -> None:
    alone = Recording(scene.recording.cameras[:1], scene.recording.epoch_ns)
    found = examine(alone, HALF_SECOND)
    assert not found.will_calibrate
    assert [one.reason for one in found.rejections] == [RejectionReason.TOO_FEW_CAMERAS]


def test_a_clock_of_another_epoch_is_named_and_the_others_calibrate(scene: Scene) -> None:
    shifted = changed(scene.recording, "cam1", clock_shifted(3600.0))
    assert examine(shifted, HALF_SECOND).calibrated == ("cam0", "cam1", "cam2")
    found = examine(shifted, replace(HALF_SECOND, align="stamps"))
    assert found.calibrated == ("cam0", "cam2")
    assert [one.reason for one in found.reasons] == [RejectionReason.CLOCK_EPOCH_DIFFERS]
    assert found.cameras[1].common_fraction == 0.0
    assert AdviceCode.RECORD_TOGETHER in codes(found)


def test_strangers_do_not_calibrate(scene: Scene) -> None:
    other = simulate(replace(SMALL, n_frames=150, seed=77)).recording.cameras[1]
    strangers = Recording((scene.recording.cameras[0], other), scene.recording.epoch_ns)
    found = examine(strangers, HALF_SECOND)
    assert not found.will_calibrate
    assert found.rejections[0].reason is RejectionReason.NO_SHARED_MOTION
    assert max(fit.explained for fit in found.fits.values()) < MIN_EXPLAINED


def test_a_camera_that_sees_half_of_the_people_is_no_stranger(scene: Scene) -> None:
    def one_person(camera: CameraRecording) -> CameraRecording:
        return replace(camera, tracks=camera.tracks[:1])

    two = Recording(scene.recording.cameras[:2], scene.recording.epoch_ns)
    found = examine(changed(two, "cam1", one_person), HALF_SECOND)
    assert found.fits["cam0"].explained < MIN_EXPLAINED
    assert found.will_calibrate
    assert found.doubtful == ("cam0",)


def test_faults_and_what_is_put_right_are_those_of_the_calibration(scene: Scene) -> None:
    percent = tracks_changed(lambda track: replace(track, scores=100.0 * track.scores))
    low = tracks_changed(lambda track: replace(track, scores=0.1 * track.scores))
    recording = changed(changed(scene.recording, "cam1", percent), "cam2", low)
    found = examine(recording, HALF_SECOND)
    assert RemarkCode.SCORES_IN_PERCENT in {one.code for one in found.remarks}
    assert [one.name for one in found.uncalibrated] == ["cam2"]
    assert found.calibrated == ("cam0", "cam1")


def test_what_cannot_be_computed_at_all_is_said_with_what_there_is(scene: Scene) -> None:
    cameras = tuple(
        replace(c, intrinsics=replace(c.intrinsics, K=1e-3 * c.intrinsics.K))
        for c in scene.recording.cameras
    )
    found = examine(replace(scene.recording, cameras=cameras), HALF_SECOND)
    assert not found.will_calibrate
    assert "focal lengths" in found.unusable
    assert len(found.cameras) == 3


def test_a_gap_and_a_low_rate_are_advised_against(scene: Scene) -> None:
    camera = scene.recording.cameras[1]
    number = np.arange(len(camera.stamps))
    few = only_images(camera, (number % 6 == 0) & ~((number > 40) & (number < 90)))
    found = examine(changed(scene.recording, "cam1", lambda _: few), HALF_SECOND)
    assert {AdviceCode.IMAGES_MISSING, AdviceCode.MORE_IMAGES} <= codes(found)
    assert found.cameras[1].longest_gap_s > 1.6


def test_a_camera_with_one_partner_is_advised_to_have_more(good: Diagnosis) -> None:
    pairs = (
        PairFacts("cam0", "cam1", 2, 60.0, 0.0, 1.0),
        PairFacts("cam0", "cam2", 2, 60.0, 0.0, 1.0),
        PairFacts("cam1", "cam2"),
    )
    advice = advise(replace(good, pairs=pairs))
    assert [(one.code, one.cameras) for one in advice] == [
        (AdviceCode.ONE_PARTNER, ("cam1", "cam0")),
        (AdviceCode.ONE_PARTNER, ("cam2", "cam0")),
    ]
    assert "cam1 sees the same people as cam0, but as no other" in advice[0].sentence


def test_little_in_common_is_advised_against_once_if_all_have_it(good: Diagnosis) -> None:
    short = replace(good, pairs=tuple(replace(p, shared_s=3.0) for p in good.pairs))
    assert [one.code for one in advise(short)] == [AdviceCode.RECORD_LONGER]
    one_short = replace(short, pairs=(replace(short.pairs[0], shared_s=60.0), *short.pairs[1:]))
    assert [(one.code, one.cameras[0]) for one in advise(one_short)] == [
        (AdviceCode.SHARE_MORE_MOTION, "cam2")
    ]
