"""3D poses that are called metric, and are not in metres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import HALF_SECOND, every, tracks_changed

import stcalib_ros as st
from stcalib_ros.core.lifting.pose_units import in_metres
from stcalib_ros.core.model.rejection import RemarkCode

C = RemarkCode


def scaled(factor):
    return tracks_changed(lambda track: replace(track, joints=factor * track.joints))


@pytest.mark.parametrize("factor", [0.75, 1.0, 1.3])
def test_people_of_usual_size_are_left_alone(small_scene, factor):
    cameras = every(small_scene.recording, scaled(factor)).cameras
    assert in_metres(cameras) == (cameras, ())


@pytest.mark.parametrize(
    ("factor", "unit", "height_m"), [(1000, "millimetres", 1720), (100, "centimetres", 172)]
)
@pytest.mark.parametrize("which", [(1,), (0, 1, 2)])
def test_known_units_are_converted(small_scene, factor, unit, height_m, which):
    given = small_scene.recording.cameras
    cameras = [scaled(factor)(c) if k in which else c for k, c in enumerate(given)]
    found, remarks = in_metres(cameras)
    assert [remark.cameras for remark in remarks] == [(given[k].name,) for k in which]
    for remark in remarks:
        assert (remark.code, remark.detail) == (C.POSES_RESCALED, unit)
        assert remark.values["height_m"] == pytest.approx(height_m, rel=0.2)
    for before, after in zip(given, found, strict=True):
        assert after.metric
        for one, other in zip(before.tracks, after.tracks, strict=True):
            np.testing.assert_allclose(one.joints, other.joints)


@pytest.mark.parametrize("factor", [0.5, 2.0, 1.0 / 1.72, 10.0, 0.001])
def test_poses_of_another_size_are_not_metric(small_scene, factor):
    given = small_scene.recording.cameras
    one_of_three, remarks = in_metres([given[0], scaled(factor)(given[1]), given[2]])
    assert [(remark.code, remark.cameras) for remark in remarks] == [
        (C.POSES_NOT_METRIC, ("cam1",))
    ]
    assert [camera.has_3d_poses for camera in one_of_three] == [True, False, True]
    every_one, remarks = in_metres([scaled(factor)(camera) for camera in given])
    assert len(remarks) == 3
    assert [(c.metric, c.has_3d_poses) for c in every_one] == 3 * [(False, True)]


def test_poses_up_to_scale_and_keypoints_alone_may_have_any_size(small_scene):
    large = every(small_scene.recording, scaled(1000.0))
    relative = tuple(replace(camera, metric=False) for camera in large.cameras)
    assert in_metres(relative) == (relative, ())
    without = st.keypoints_only(large).cameras
    assert in_metres(without) == (without, ())
    nobody = tuple(replace(camera, tracks=()) for camera in large.cameras)
    assert in_metres(nobody) == (nobody, ())


@pytest.mark.parametrize("factor", [1000.0, 0.5])
def test_the_unit_of_one_camera_does_not_sink_the_others(factor):
    recording = st.simulate(st.SceneOptions(n_cameras=3, n_people=2, n_frames=180)).recording
    expected = st.calibrate(recording, HALF_SECOND)
    first, *others = recording.cameras
    given = replace(recording, cameras=(scaled(factor)(first), *others))
    found = st.calibrate(given, HALF_SECOND)
    assert (found.status.name, found.metric) == ("OK", True)
    assert "cam0: by the 3D poses, people would be" in found.message
    for one, other in zip(found.cameras, expected.cameras, strict=True):
        np.testing.assert_allclose(one.t_ref_cam, other.t_ref_cam, atol=0.3)
