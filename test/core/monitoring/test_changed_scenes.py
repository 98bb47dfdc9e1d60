"""Whole scenes under watch, with errors: what must be noticed, and what must not."""

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import SMALL, changed, tracks_changed

from stcalib_ros.core.model.calibration import PairResidual
from stcalib_ros.core.model.recording import excerpt, keypoints_only
from stcalib_ros.core.monitoring.alarms import State, Thresholds, Verdict, judge
from stcalib_ros.core.monitoring.limits import KEPT_SPANS, SPAN_S
from stcalib_ros.core.monitoring.matching import associate_span
from stcalib_ros.core.monitoring.spans import check_span
from stcalib_ros.core.synthetic import CameraChange, simulate

LONG = replace(SMALL, n_frames=30 * 18, keypoint_bias_mm=10.0, seed=21)
TURN = tuple(np.radians([0.0, 2.0, 0.0]))
BACK = tuple(-np.array(TURN))


def watched(recording, calibration):
    """Verdicts after every span."""
    offsets = {c.name: c.time_offset_s for c in calibration.cameras}
    verdicts = {c.name: Verdict(c.name) for c in calibration.cameras}
    spans, out = [], []
    for start_s in np.arange(0.0, recording.cameras[0].stamps[-1] - SPAN_S, SPAN_S):
        part = excerpt(recording, start_s, start_s + SPAN_S, offsets_s=offsets)
        span = check_span(
            part,
            calibration,
            start_s=start_s,
            end_s=start_s + SPAN_S,
            min_score=0.3,
            noise=spans[-1].noise if spans else None,
        )
        spans = [*spans, span][-KEPT_SPANS:]
        verdicts = judge(spans, verdicts, Thresholds())
        out.append(verdicts)
    return out


def states(history, name):
    return [verdicts[name].state for verdicts in history]


@pytest.fixture(scope="module")
def quiet():
    return simulate(LONG)


@pytest.mark.parametrize("without_3d", [[], ["cam1"], ["cam0", "cam1", "cam2"]])
def test_a_camera_that_is_turned_and_moved_back(without_3d):
    scene = simulate(
        LONG,
        changes=[CameraChange(1, 3.0, turn_rad=TURN), CameraChange(1, 11.0, turn_rad=BACK)],
    )
    recording = keypoints_only(scene.recording, without_3d)
    history = watched(recording, scene.truth)
    found = states(history, "cam1")
    first, last = found.index(State.MOVED), len(found) - 1 - found[::-1].index(State.MOVED)
    assert SPAN_S * (first + 1) <= 3.0 + 10.0
    assert found[last + 1 :] == [State.OK] * (len(found) - last - 1) != []
    assert history[-1]["cam1"].since_s >= 11.0
    for other in ("cam0", "cam2"):
        assert set(states(history, other)) == {State.OK}


@pytest.mark.parametrize("reported_px", [0.0, 130.0, np.nan])
@pytest.mark.parametrize("change", [{"turn_rad": TURN}, {"clock_s": 0.1}], ids=["turn", "jump"])
def test_two_cameras_with_exchanged_ids_whatever_residual_was_reported(change, reported_px):
    options = replace(LONG, n_cameras=2, n_people=3, id_switches_per_10s=1.0, n_frames=30 * 14)
    scene = simulate(options, changes=[CameraChange(1, 3.0, **change)])
    pair = PairResidual("cam0", "cam1", 3, 0.1, reported_px)
    old = replace(scene.truth, pairs=(pair,), reprojection_rms_px=reported_px)
    history = watched(scene.recording, old)
    alarms = [k for k, verdicts in enumerate(history) if verdicts["cam1"].state.alarm]
    assert 3.0 <= SPAN_S * (alarms[0] + 1) <= 3.0 + 10.0
    assert history[alarms[0]]["cam1"].suspects == ("cam0", "cam1")


def test_the_reference_is_watched_too():
    scene = simulate(LONG, changes=[CameraChange(0, 3.0, turn_rad=TURN)])
    history = watched(scene.recording, scene.truth)
    assert states(history, "cam0")[-1] is State.MOVED
    assert {states(history, n)[-1] for n in ("cam1", "cam2")} == {State.OK}


def test_bad_detections_are_no_motion(quiet, rng):
    def noisy(track):
        noise = 8.0 * rng.standard_normal(track.keypoints.shape)
        return replace(track, keypoints=track.keypoints + noise)

    recording = changed(quiet.recording, "cam1", tracks_changed(noisy))
    history = watched(recording, quiet.truth)
    assert not any(v.state.alarm for verdicts in history for v in verdicts.values())


def test_people_who_are_hidden_are_no_motion(quiet):
    def hidden(track):
        rows = track.frames % 150 < 60
        return replace(
            track,
            frames=track.frames[rows],
            keypoints=track.keypoints[rows],
            joints=track.joints[rows],
            scores=track.scores[rows],
        )

    recording = changed(quiet.recording, "cam2", tracks_changed(hidden))
    history = watched(recording, quiet.truth)
    assert not any(v.state.alarm for verdicts in history for v in verdicts.values())


def test_another_camera_in_its_place():
    scene, other = simulate(LONG), simulate(replace(LONG, seed=22))
    recording = changed(scene.recording, "cam1", lambda _: other.recording.cameras[1])
    history = watched(recording, scene.truth)
    assert states(history, "cam1")[-1] is State.UNMATCHED
    assert not any(v[n].state.alarm for v in history for n in ("cam0", "cam2"))


def test_nobody_is_expected_where_a_camera_does_not_look(quiet):
    R = np.diag([-1.0, 1.0, -1.0])
    cameras = tuple(
        replace(c, R_ref_cam=c.R_ref_cam @ R) if c.name == "cam1" else c
        for c in quiet.truth.cameras
    )
    empty = changed(quiet.recording, "cam1", lambda c: replace(c, tracks=()))
    obs = associate_span(
        excerpt(empty, 0.0, 2.0), replace(quiet.truth, cameras=cameras), min_score=0.3
    )
    assert (obs.expected[1], obs.missed[1]) == (0, 0)
