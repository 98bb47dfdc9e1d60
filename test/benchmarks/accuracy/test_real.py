"""The real recordings are what their README says."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.accuracy import real
from stcalib_ros.core.evaluation.metrics import triangulation_errors
from stcalib_ros.core.geometry.interpolation import Interpolation
from stcalib_ros.core.geometry.lens import bearings


def median_errors_px(recording, truth, person, joints):
    """Errors (C,) of the joints of one person, triangulated with the true cameras at true times."""
    R = np.stack([camera.R_ref_cam for camera in truth.cameras])
    t = np.stack([camera.t_ref_cam for camera in truth.cameras])
    times = recording.cameras[0].stamps
    x, focal = [], []
    for camera, true in zip(recording.cameras, truth.cameras, strict=True):
        (track,) = (t for t in camera.tracks if t.track_id in person.tracks[camera.name])
        columns = [camera.layout.index(name) for name in joints]
        seen = np.where(track.scores[:, columns, None] > 0.3, track.keypoints[:, columns], np.nan)
        own_x, own_focal = bearings(seen, camera.intrinsics)
        stamps = camera.stamps[track.frames] + true.time_offset_s
        at = Interpolation(stamps, times, period=float(np.median(np.diff(stamps))))
        x.append(at(own_x))
        focal.append(at(own_focal))
    x, focal = np.stack(x, -2), np.stack(focal, -1)
    observed = np.isfinite(x).all(-1)
    errors = triangulation_errors(R, t, np.nan_to_num(x), np.nan_to_num(focal, nan=1.0), observed)
    return np.nanmedian(errors.reshape(-1, len(R)), axis=0)


ARMS = [f"{side}_{joint}" for side in ("left", "right") for joint in ("shoulder", "elbow", "wrist")]
LEGS = [f"{side}_{joint}" for side in ("left", "right") for joint in ("hip", "knee", "ankle")]


@pytest.mark.parametrize(
    ("read", "person", "joints", "px"),
    [
        (real.read_balance, 0, ARMS + LEGS, (8.0, 8.0, 10.0, 9.0)),
        (real.read_balance, 1, ARMS + LEGS, (1.5, 1.5, 1.5, 1.5)),
        (real.read_balance_one, 0, ARMS + LEGS, (8.0, 8.0, 10.0, 9.0)),
        (real.read_desk, 0, ARMS, (22.0, 18.0, 18.0, 12.0)),
    ],
)
def test_keypoints_agree_with_the_truth(read, person, joints, px):
    recording, truth = read()
    (one,) = (p for p in truth.persons if p.person_id == person)
    assert (median_errors_px(recording, truth, one, joints) < px).all()


def test_clocks_are_shifted_by_no_whole_frames():
    for read, shifts, fps in (
        (real.read_balance, real.BALANCE_SHIFTS_S, real.BALANCE_FPS),
        (real.read_desk, real.DESK_SHIFTS_S, real.DESK_FPS),
    ):
        recording, truth = read()
        offsets = {camera.name: camera.time_offset_s for camera in truth.cameras}
        names = [camera.name for camera in recording.cameras]
        assert offsets == {name: pytest.approx(-shifts.get(name, 0.0)) for name in names}
        frames = np.array(list(shifts.values())) * fps
        assert (np.abs(frames - np.round(frames)) > 0.01).all()


def test_there_are_no_3d_poses():
    for case in real.KEYPOINT_CASES:
        recording, _ = case.read()
        tracks = [track for camera in recording.cameras for track in camera.tracks]
        assert tracks
        assert all(np.isnan(track.joints).all() for track in tracks)


def test_one_of_the_people_can_be_left_out():
    two, one = (read()[1].persons for read in (real.read_balance, real.read_balance_one))
    assert [p.person_id for p in two] == [0, 1, 2]
    assert [p.person_id for p in one] == [0, 2]


def test_images_that_a_webcam_missed_are_not_there():
    recording, _ = real.read_desk()
    assert [len(camera.stamps) for camera in recording.cameras] == [267, 262, 267, 266]
    assert all((np.diff(camera.stamps) > 0.015).all() for camera in recording.cameras)
    assert all(t.frames.max() < len(c.stamps) for c in recording.cameras for t in c.tracks)
