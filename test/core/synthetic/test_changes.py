"""Cameras to which something happens while they record."""

import numpy as np
import pytest
from core_helpers import EXACT, SMALL

from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.synthetic import CameraChange, simulate
from stcalib_ros.core.synthetic.changes import poses_over_time, stamps_over_time

TURN, SHIFT = (0.1, -0.2, 0.05), (0.3, 0.0, -0.1)
TIMES = np.arange(5.0)


def test_a_camera_turns_and_moves_in_its_own_frame(rng):
    R, t = exp_so3(rng.standard_normal(3)), rng.standard_normal(3)
    change = CameraChange(0, 2.5, turn_rad=TURN, shift_m=SHIFT)
    R_after, t_after = poses_over_time(R, t, TIMES, [change])
    np.testing.assert_array_equal(R_after[:3], np.tile(R, (3, 1, 1)))
    centre, moved = -R.T @ t, -R_after[3].T @ t_after[3]
    np.testing.assert_allclose(moved - centre, R.T @ SHIFT, atol=1e-12)
    np.testing.assert_allclose(R_after[3].T, R.T @ exp_so3(np.array(TURN)), atol=1e-12)


def test_changes_add_up(rng):
    R, t = exp_so3(rng.standard_normal(3)), rng.standard_normal(3)
    back = [
        CameraChange(0, 1.0, turn_rad=TURN),
        CameraChange(0, 3.0, turn_rad=tuple(-np.array(TURN))),
    ]
    R_after, t_after = poses_over_time(R, t, TIMES, back)
    np.testing.assert_allclose(R_after[3:], np.tile(R, (2, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(t_after[3:], np.tile(t, (2, 1)), atol=1e-12)


def test_stamps_never_go_back():
    jump = CameraChange(0, 2.0, clock_s=-1.5)
    found = stamps_over_time(TIMES, TIMES, [jump])
    np.testing.assert_array_equal(found, [0.0, 1.0, np.nan, 1.5, 2.5])


def test_the_people_walk_on_and_the_others_see_the_same():
    change = CameraChange(1, 1.5, turn_rad=TURN, shift_m=SHIFT)
    plain, changed = simulate(SMALL), simulate(SMALL, changes=[change])
    for c, (a, b) in enumerate(
        zip(plain.recording.cameras, changed.recording.cameras, strict=True)
    ):
        for p, q in zip(a.tracks, b.tracks, strict=False):
            n = 30 if c == 1 else None
            np.testing.assert_allclose(p.keypoints[:n], q.keypoints[:n], atol=1e-6)
    np.testing.assert_array_equal(
        plain.truth.cameras[1].R_ref_cam, changed.truth.cameras[1].R_ref_cam
    )


def test_key_points_are_those_of_the_turned_camera():
    scene = simulate(EXACT, changes=[CameraChange(1, 1.0, turn_rad=TURN)])
    camera, rig = scene.recording.cameras[1], scene.rig
    track = camera.tracks[0]
    person = scene.track_persons["cam1"][track.track_id][-1]
    last = track.frames[-1]
    X = scene.joints_world(scene.exposures_s[1][[last]])[person, 0]
    X_cam = (X @ rig.R_cam_world[1].T + rig.t_cam_world[1]) @ exp_so3(np.array(TURN))
    seen = np.isfinite(track.keypoints[-1, :, 0])
    expected = project(X_cam, camera.intrinsics)
    np.testing.assert_allclose(track.keypoints[-1][seen], expected[seen], atol=1e-6)


@pytest.mark.parametrize(("clock_s", "lost"), [(0.1, 0), (-0.1, 3)])
def test_a_clock_that_jumps(clock_s, lost):
    scene = simulate(EXACT, changes=[CameraChange(2, 1.0, clock_s=clock_s)])
    stamps, exposures = scene.recording.cameras[2].stamps, scene.exposures_s[2]
    assert len(stamps) == EXACT.n_frames - lost
    assert (np.diff(stamps) > 0).all()
    expected = np.where(exposures >= 1.0, clock_s, 0.0)
    np.testing.assert_allclose(stamps - exposures, expected, atol=1e-9)
