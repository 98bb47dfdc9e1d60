"""What cameras of the same and of different layouts have in common."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import changed, every

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS, layout_from_names
from stcalib_ros.core.model.skeleton import bone_vectors, common_skeleton


def test_seventeen_joints_give_nineteen_directions():
    directions, names = bone_vectors(LAYOUTS["h36m_17"])
    assert directions.shape == (19, 17)
    assert names[-3:] == ("hips", "shoulders", "torso")
    assert len(set(names)) == 19


@pytest.mark.parametrize("name", LAYOUTS)
def test_directions_do_not_depend_on_the_origin(name):
    directions, _ = bone_vectors(LAYOUTS[name])
    np.testing.assert_allclose(directions.sum(1), 0, atol=1e-15)


def test_bones_point_from_parent_to_joint():
    layout = layout_from_names(
        ["left_hip", "left_knee", "right_hip", "left_shoulder", "right_shoulder"]
    )
    directions, names = bone_vectors(layout)
    joints = np.array([[0.1, 0, 1], [0.1, 0, 0.5], [-0.1, 0, 1], [0.2, 0, 1.5], [-0.2, 0, 1.5]])
    bones = dict(zip(names, directions @ joints, strict=True))
    np.testing.assert_allclose(bones["left_hip left_knee"], [0, 0, -0.5])
    np.testing.assert_allclose(bones["hips"], [0.2, 0, 0])
    np.testing.assert_allclose(bones["shoulders"], [0.4, 0, 0])
    np.testing.assert_allclose(bones["torso"], [0, 0, 0.5])


def test_one_layout_is_taken_as_it_is(exact_scene):
    skeleton = common_skeleton(exact_scene.recording)
    assert skeleton.layout is LAYOUTS["h36m_17"]
    for columns in skeleton.columns:
        np.testing.assert_array_equal(columns, np.arange(17))


def with_layout(recording, camera, layout):
    return changed(recording, camera, lambda c: replace(c, layout=layout))


def test_of_different_layouts_the_shared_joints_are_taken_by_name(exact_scene):
    recording = with_layout(exact_scene.recording, "cam1", LAYOUTS["coco_17"])
    skeleton = common_skeleton(recording)
    shared = skeleton.layout.joint_names
    assert set(shared) == set(LAYOUTS["h36m_17"].joint_names) & set(LAYOUTS["coco_17"].joint_names)
    for camera, columns in zip(recording.cameras, skeleton.columns, strict=True):
        assert tuple(camera.layout.joint_names[i] for i in columns) == shared


def test_of_a_whole_body_only_body_and_feet_are_taken(exact_scene):
    whole = LAYOUTS["coco_wholebody_133"]
    recording = every(exact_scene.recording, lambda c: replace(c, layout=whole))
    skeleton = common_skeleton(recording)
    assert skeleton.layout.joint_names == whole.joint_names[:23]
    for columns in skeleton.columns:
        np.testing.assert_array_equal(columns, np.arange(23))


def test_the_order_of_the_joints_may_differ(exact_scene):
    names = LAYOUTS["h36m_17"].joint_names
    turned = layout_from_names(names[::-1], name="turned")
    skeleton = common_skeleton(with_layout(exact_scene.recording, "cam1", turned))
    assert skeleton.layout.joint_names == names
    np.testing.assert_array_equal(skeleton.columns[1], np.arange(17)[::-1])


def test_adult_lengths_are_known_for_limbs_of_every_layout(exact_scene):
    for name in LAYOUTS:
        layout = LAYOUTS[name]
        recording = replace(
            exact_scene.recording,
            cameras=tuple(replace(c, layout=layout) for c in exact_scene.recording.cameras),
        )
        known = np.isfinite(common_skeleton(recording).adult_lengths)
        assert known.sum() == 9, name


def test_layouts_with_too_little_in_common_are_said(exact_scene):
    hands = layout_from_names(["left_wrist", "left_thumb", "left_pinky", "left_index"], name="hand")
    recording = with_layout(exact_scene.recording, "cam2", hands)
    with pytest.raises(
        InputError, match=r"cam0: h36m_17, .*cam2: hand.* only 1 joints and 0 bones"
    ):
        common_skeleton(recording)
