"""3D poses that do not project onto their own keypoints, and how they have to be read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import tracks_changed

import stcalib_ros as st
from stcalib_ros.core.lifting.limits import MIN_HANDEDNESS, MIN_PROJECTION, SURE_PROJECTION
from stcalib_ros.core.lifting.pose_axes import handedness, pose_axes, with_projecting_poses
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS, layout_from_names
from stcalib_ros.core.model.rejection import RemarkCode
from stcalib_ros.core.model.skeleton import mirrored_joints

AXES = {
    "x right, y up, z backward": np.diag([1.0, -1.0, -1.0]),
    "x right, y up, z forward": np.diag([1.0, -1.0, 1.0]),
    "x left, y forward, z up": np.array([[-1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "x forward, y left, z up": np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]),
    "x forward, y down, z left": np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    "x right, y down, z backward": np.diag([1.0, 1.0, -1.0]),
}


def scene(**options):
    return st.simulate(st.SceneOptions(n_cameras=2, n_people=2, n_frames=120, seed=3, **options))


@pytest.fixture(scope="module")
def camera():
    return scene().recording.cameras[1]


def with_joints(change):
    return tracks_changed(lambda track: replace(track, joints=change(track.joints)))


@pytest.mark.parametrize("options", [{}, {"tilt_deg": 15.0, "lifter_mm": (80, 120)}])
@pytest.mark.parametrize("words", AXES)
def test_axes_are_named(words, options):
    given = scene(**options).recording.cameras[1]
    turned = with_joints(lambda joints: joints @ AXES[words].T)(given)
    read = pose_axes(turned, min_score=0.3)
    assert (read.words, read.sides_exchanged, read.layout) == (words, False, "")
    assert read.best > SURE_PROJECTION
    stripped, (remark,) = with_projecting_poses(turned, min_score=0.3)
    assert not stripped.has_3d_poses
    assert (remark.code, remark.cameras) == (RemarkCode.POSES_IN_OTHER_AXES, ("cam1",))
    assert remark.detail == words
    assert remark.values == {"given": read.given, "best": read.best}


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"tilt_deg": 20.0},
        {"crop_perspective": 0.0, "focal_px": 700.0},
        {"people": "gesturing"},
        {"lifter_mm": (80, 120), "lifter_depth_ratio": 3.0, "tilt_deg": 15.0},
    ],
)
def test_poses_of_lifters_are_left_alone(options):
    for given in scene(**options).recording.cameras:
        assert with_projecting_poses(given, min_score=0.3) == (given, ())


def test_exchanged_sides_are_named(camera):
    mirrored = mirrored_joints(camera.layout)
    exchanged = with_joints(lambda joints: joints[:, mirrored])(camera)
    read = pose_axes(exchanged, min_score=0.3)
    assert (read.axes, read.sides_exchanged, read.words) == (None, True, "")
    _, (remark,) = with_projecting_poses(exchanged, min_score=0.3)
    assert remark.code is RemarkCode.POSES_WITH_SIDES_EXCHANGED


def test_joints_in_the_order_of_another_layout_are_named(camera):
    own = list(camera.layout.joint_names)
    columns = [own.index(n if n in own else "head") for n in LAYOUTS["coco_17"].joint_names]
    _, (remark,) = with_projecting_poses(
        with_joints(lambda joints: joints[:, columns])(camera), min_score=0.3
    )
    assert (remark.code, remark.detail) == (RemarkCode.POSES_IN_OTHER_ORDER, "coco_17")


def test_poses_of_no_order_do_not_project(camera):
    shuffled = np.random.default_rng(0).permutation(camera.layout.n_joints)
    _, (remark,) = with_projecting_poses(
        with_joints(lambda joints: joints[:, shuffled])(camera), min_score=0.3
    )
    assert (remark.code, remark.detail) == (RemarkCode.POSES_DO_NOT_PROJECT, "")
    assert remark.values["given"] < MIN_PROJECTION


def test_nothing_is_said_of_few_poses_or_none(camera):
    few = tracks_changed(
        lambda t: replace(
            t,
            frames=t.frames[:4],
            **{n: getattr(t, n)[:4] for n in ("keypoints", "joints", "scores")},
        )
    )(camera)
    upside_down = with_joints(lambda joints: -joints)
    assert pose_axes(upside_down(few), min_score=0.3) is None
    assert pose_axes(upside_down(camera), min_score=0.3) is not None
    assert pose_axes(upside_down(camera), min_score=1.1) is None
    assert pose_axes(with_joints(lambda j: np.full_like(j, np.nan))(camera), min_score=0.3) is None


def test_bodies_bend_one_way(camera):
    joints = np.concatenate([track.joints for track in camera.tracks])
    hand = handedness(joints, camera.layout)
    assert hand > MIN_HANDEDNESS
    assert handedness(joints * [1, 1, -1], camera.layout) == pytest.approx(-hand)
    assert handedness(joints @ AXES["x forward, y left, z up"].T, camera.layout) == pytest.approx(
        hand
    )
    unnamed = layout_from_names([f"joint{k}" for k in range(17)])
    assert handedness(joints, unnamed) == 0.0


def test_cameras_with_poses_in_other_axes_are_calibrated_by_keypoints():
    wrong = with_joints(lambda joints: joints @ AXES["x forward, y left, z up"].T)
    recording = st.simulate(st.SceneOptions(n_cameras=3, n_people=2, n_frames=180)).recording
    given = replace(recording, cameras=tuple(wrong(c) for c in recording.cameras))
    options = st.Options(offset_range_s=0.5)
    found, expected = (st.calibrate(one, options) for one in (given, st.keypoints_only(recording)))
    assert (found.status.name, found.metric) == ("OK", False)
    assert found.message.count("axes were x forward, y left, z up") == 1
    for one, other in zip(found.cameras, expected.cameras, strict=True):
        np.testing.assert_array_equal(one.R_ref_cam, other.R_ref_cam)
