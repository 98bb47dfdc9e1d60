"""Calibrations from 2D poses, and from recordings in which some have 3D poses and some have not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import HALF_SECOND, error, every, tracks_changed

from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.core.model.recording import keypoints_only, unknown_joints
from stcalib_ros.core.pipeline import calibrate, run_stages
from stcalib_ros.core.synthetic import Scene, SceneOptions, simulate

WHOLE_BODY = LAYOUTS["coco_wholebody_133"]


@pytest.fixture(scope="module")
def walk() -> Scene:
    return simulate(SceneOptions(n_cameras=3, n_people=2, n_frames=180))


def of_tracks(recording, without_3d):
    """Without the 3D poses of the tracks with such an id."""
    change = tracks_changed(
        lambda t: replace(t, joints=unknown_joints(t.keypoints)) if without_3d(t.track_id) else t
    )
    return every(recording, change)


def of_images(recording):
    """With the 3D poses of every third image."""

    def change(track):
        unknown = (track.frames % 3 > 0)[:, None, None]
        return replace(track, joints=np.where(unknown, np.nan, track.joints))

    return every(recording, tracks_changed(change))


def whole_body(camera):
    """The joints that Human3.6M has in common; the rest is not detected."""
    own = camera.layout
    columns = [
        own.joint_names.index(n) if n in own.joint_names else -1 for n in WHOLE_BODY.joint_names
    ]

    def widened(values):
        missing = np.full_like(values[:, :1], np.nan)
        return np.concatenate([values, missing], axis=1)[:, columns]

    change = tracks_changed(
        lambda t: replace(
            t,
            keypoints=widened(t.keypoints),
            joints=unknown_joints(widened(t.keypoints)),
            scores=np.nan_to_num(widened(t.scores)),
        )
    )
    return replace(change(camera), layout=WHOLE_BODY)


MIXED = {
    "no camera": keypoints_only,
    "one camera without": lambda r: keypoints_only(r, ["cam1"]),
    "one camera with": lambda r: keypoints_only(r, ["cam0", "cam2"]),
    "some tracks": lambda r: of_tracks(r, lambda track_id: track_id % 2),
    "some images": of_images,
    "a whole body": lambda r: every(r, whole_body),
}


@pytest.mark.parametrize("change", MIXED.values(), ids=MIXED)
def test_cameras_are_calibrated_with_as_many_3d_poses_as_there_are(walk, change):
    calibration = calibrate(change(walk.recording), HALF_SECOND)
    assert calibration.status is Status.OK, calibration.message
    assert [camera.name for camera in calibration.cameras] == ["cam0", "cam1", "cam2"]
    e = error(calibration, walk.truth)
    assert e.E_R < 0.002
    assert e.E_t < 0.005
    assert e.E_delta < 0.1
    assert e.precision == 1.0


def test_numbers_do_not_depend_on_how_missing_3d_poses_are_given(walk):
    """An array that takes no memory, or one that is full of NaN."""
    flat = keypoints_only(walk.recording)
    written_out = every(flat, tracks_changed(lambda t: replace(t, joints=t.joints.copy())))
    one, other = (calibrate(recording, HALF_SECOND) for recording in (flat, written_out))
    for a, b in zip(one.cameras, other.cameras, strict=True):
        np.testing.assert_array_equal(a.t_ref_cam, b.t_ref_cam)
        assert a.time_offset_s == b.time_offset_s


def test_only_body_and_feet_of_whole_bodies_are_adjusted(walk):
    stages = run_stages(every(walk.recording, whole_body), HALF_SECOND)
    assert stages.skeleton.layout.n_joints == 23
    assert {camera.tracks[0].x.shape[1] for camera in stages.lifted} == {23}
