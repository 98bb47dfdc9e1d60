"""Keypoints with x and y swapped, and joints in the order of another layout."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import tracks_changed

from stcalib_ros.core.lifting.keypoint_axes import (
    disproportion,
    turned_images,
    with_own_layout,
    with_x_before_y,
)
from stcalib_ros.core.lifting.limits import MAX_PROPORTIONS, ORDER_MARGIN
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.core.model.recording import Recording, keypoints_only
from stcalib_ros.core.model.rejection import RemarkCode

LIMIT = 0.3
H36M, COCO = LAYOUTS["h36m_17"].joint_names, LAYOUTS["coco_17"].joint_names
AS_COCO = [H36M.index(name if name in H36M else "head") for name in COCO]


@pytest.fixture(scope="module")
def camera(small_scene):
    return small_scene.recording.cameras[1]


def with_keypoints(change):
    return tracks_changed(lambda track: replace(track, keypoints=change(track.keypoints)))


def ordered(camera, columns):
    def change(track):
        arrays = (getattr(track, name)[:, columns] for name in ("keypoints", "joints", "scores"))
        return replace(track, **dict(zip(("keypoints", "joints", "scores"), arrays, strict=True)))

    return tracks_changed(change)(camera)


def swapped(points):
    return points[..., ::-1]


def bare(camera):
    return keypoints_only(Recording((camera,))).cameras[0]


def aside(points):
    """People further to the right: beyond the height of the image."""
    return points + np.array([350.0, 0.0])


def test_sound_keypoints_are_left_alone(camera):
    for given in (camera, bare(camera), replace(camera, tracks=())):
        for step in (with_own_layout, with_x_before_y):
            read = step(given, min_score=LIMIT)
            assert (read.camera, read.remarks, read.fault) == (given, (), None)


def test_swapped_keypoints_are_exchanged_back_where_3d_poses_stand(camera):
    read = with_x_before_y(with_keypoints(swapped)(camera), min_score=LIMIT)
    assert [remark.code for remark in read.remarks] == [RemarkCode.KEYPOINTS_SWAPPED]
    for before, after in zip(camera.tracks, read.camera.tracks, strict=True):
        np.testing.assert_array_equal(after.keypoints, before.keypoints)


def test_or_where_they_are_outside_of_the_image(camera):
    wrong = with_keypoints(lambda points: swapped(aside(points)))(bare(camera))
    read = with_x_before_y(wrong, min_score=LIMIT)
    assert [remark.code for remark in read.remarks] == [RemarkCode.KEYPOINTS_SWAPPED]


@pytest.mark.parametrize("turned", [[1.0, -1.0], [-1.0, 1.0]])
def test_a_camera_on_its_side_is_left_alone(camera, turned):
    """Its 3D poses lie as the people in its image do."""

    def on_its_side(track):
        points = swapped(track.keypoints - [960.0, 540.0]) * turned + [960.0, 540.0]
        joints = track.joints[..., [1, 0, 2]] * [*turned, 1.0]
        return replace(track, keypoints=points, joints=joints)

    given = tracks_changed(on_its_side)(camera)
    assert with_x_before_y(given, min_score=LIMIT).remarks == ()
    assert with_x_before_y(bare(given), min_score=LIMIT).remarks == ()


@pytest.mark.parametrize("quarters", [0, 1, 2, 3])
def test_an_image_that_is_turned_is_named(small_scene, camera, quarters):
    def turned(x):
        for side in ((1080, 1920) * 2)[:quarters]:
            x = np.stack([side - 1.0 - x[..., 1], x[..., 0]], -1)
        return x

    others = small_scene.recording.cameras[2:]
    recording = replace(small_scene.recording, cameras=(with_keypoints(turned)(camera), *others))
    found = [
        (one.code, one.cameras, one.values["turned_deg"])
        for one in turned_images(recording, min_score=LIMIT)
    ]
    expected = (RemarkCode.IMAGE_NOT_UPRIGHT, (camera.name,), {1: 90.0, 2: 180.0, 3: 90.0})
    assert found == ([] if quarters == 0 else [(*expected[:2], expected[2][quarters])])


def test_people_who_lean_in_all_directions_say_nothing(small_scene, camera, rng):
    def scattered(track):
        angle = rng.uniform(0.0, 2.0 * np.pi, len(track.frames))
        R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return replace(track, keypoints=np.einsum("abf,fjb->fja", R, track.keypoints))

    below = replace(small_scene.recording, cameras=(tracks_changed(scattered)(camera),))
    assert turned_images(below, min_score=LIMIT) == ()


def test_the_order_of_another_layout_is_recognised(camera):
    wrong = replace(ordered(camera, AS_COCO), layout=LAYOUTS["h36m_17"])
    for given in (wrong, bare(wrong)):
        read = with_own_layout(given, min_score=LIMIT)
        (remark,) = read.remarks
        assert (remark.code, remark.detail) == (RemarkCode.LAYOUT_MISTAKEN, "coco_17")
        assert read.camera.layout == LAYOUTS["coco_17"]
    back = replace(camera, layout=LAYOUTS["coco_17"])
    assert with_own_layout(back, min_score=LIMIT).camera.layout.name == "h36m_17"


def test_own_joint_names_are_taken_as_they_are(camera):
    own = replace(LAYOUTS["h36m_17"], name="own")
    wrong = replace(ordered(camera, AS_COCO), layout=own)
    assert with_own_layout(wrong, min_score=LIMIT).remarks == ()


def test_limbs_have_the_proportions_of_people(camera):
    points = np.concatenate([track.keypoints for track in camera.tracks])
    right = disproportion(points, camera.layout)
    wrong = disproportion(points, LAYOUTS["coco_17"])
    assert right < ORDER_MARGIN * MAX_PROPORTIONS < MAX_PROPORTIONS < wrong
    assert disproportion(np.full_like(points, np.nan), camera.layout) == np.inf
