"""Joint layouts: names, parents, and what is not a layout."""

from __future__ import annotations

import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.keypoint_layouts import (
    DETAILS,
    LAYOUTS,
    Layout,
    find_layout,
    layout_from_names,
)

SIZES = {
    "h36m_17": 17,
    "coco_17": 17,
    "coco_18": 18,
    "coco_19": 19,
    "coco_wholebody_133": 133,
    "body_25": 25,
    "body_25b": 25,
    "halpe_26": 26,
    "blazepose_33": 33,
    "smpl_24": 24,
    "body_38": 38,
}
LIMBS = {
    "left_elbow": "left_shoulder",
    "right_wrist": "right_elbow",
    "left_knee": "left_hip",
    "right_ankle": "right_knee",
}


def parent_of(layout: Layout, joint: str) -> str | None:
    parent = layout.parents[layout.index(joint)]
    return None if parent < 0 else layout.joint_names[parent]


def test_the_layouts_are_those_of_the_messages():
    assert {name: layout.n_joints for name, layout in LAYOUTS.items()} == SIZES
    assert all(layout.name == name for name, layout in LAYOUTS.items())


@pytest.mark.parametrize(
    ("name", "joints"),
    [
        ("coco_18", {1: "neck", 4: "right_wrist", 8: "right_hip", 13: "left_ankle"}),
        ("body_25b", {17: "upper_neck", 18: "head_top", 20: "left_small_toe", 24: "right_heel"}),
        ("halpe_26", {17: "head", 18: "neck", 19: "pelvis", 21: "right_big_toe", 25: "right_heel"}),
        ("coco_wholebody_133", {16: "right_ankle", 19: "left_heel", 22: "right_heel"}),
        ("coco_wholebody_133", {23: "face-0", 90: "face-67", 91: "left_hand_root"}),
        ("coco_wholebody_133", {95: "left_thumb4", 112: "right_hand_root"}),
        ("coco_wholebody_133", {96: "left_forefinger1", 132: "right_pinky_finger4"}),
    ],
)
def test_joints_are_where_pose_estimators_put_them(name, joints):
    """By the tables of OpenPose, Halpe-FullBody and MMPose."""
    assert {j: LAYOUTS[name].joint_names[j] for j in joints} == joints


@pytest.mark.parametrize("name", ["body_25b", "halpe_26", "coco_wholebody_133"])
def test_layouts_that_extend_that_of_coco_begin_with_it(name):
    assert LAYOUTS[name].joint_names[:17] == LAYOUTS["coco_17"].joint_names


def test_left_and_right_are_named_in_pairs():
    other = {"left": "right", "right": "left"}
    for layout in LAYOUTS.values():
        for joint in layout.joint_names:
            side, _, rest = joint.partition("_")
            if side in other:
                assert f"{other[side]}_{rest}" in layout.joint_names


def test_details_are_all_of_a_whole_body_but_body_and_feet():
    names = LAYOUTS["coco_wholebody_133"].joint_names
    assert set(names[23:]) == DETAILS
    assert not DETAILS & set(names[:23])


@pytest.mark.parametrize("name", SIZES)
def test_limbs_have_the_same_parents_in_every_layout(name):
    for joint, parent in LIMBS.items():
        assert parent_of(LAYOUTS[name], joint) == parent


@pytest.mark.parametrize("name", SIZES)
def test_parents_are_no_cycle(name):
    layout = LAYOUTS[name]
    for joint in range(layout.n_joints):
        seen, up = {joint}, layout.parents[joint]
        while up >= 0:
            assert up not in seen
            seen.add(up)
            up = layout.parents[up]


def test_a_parent_that_is_missing_is_replaced_by_its_own_parent():
    layout = layout_from_names(["pelvis", "thorax", "head_top"])
    assert parent_of(layout, "thorax") == "pelvis"
    assert parent_of(layout, "head_top") == "thorax"
    assert parent_of(layout, "pelvis") is None


def test_an_unknown_name_is_a_joint_without_a_parent():
    layout = layout_from_names(["left_hip", "left_knee", "backpack"])
    assert layout.parents == (-1, 0, -1)


def test_given_parents_take_precedence():
    names = ["left_hip", "left_knee", "backpack"]
    layout = layout_from_names(names, parent_of={"backpack": "left_hip", "left_knee": "backpack"})
    assert layout.parents == (-1, 2, 0)


def test_names_in_a_message_decide():
    names = ["left_hip", "left_knee", "left_ankle"]
    layout = find_layout("h36m_17", names)
    assert layout.joint_names == tuple(names)
    assert find_layout("", names).name == "custom"
    assert find_layout("h36m_17", LAYOUTS["h36m_17"].joint_names) is LAYOUTS["h36m_17"]
    assert find_layout("coco_17") is LAYOUTS["coco_17"]


def test_an_unknown_layout_is_said_with_those_there_are():
    with pytest.raises(InputError, match=r"unknown layout 'mpii': .*joint_names.*h36m_17, coco_17"):
        find_layout("mpii")


def test_a_joint_given_twice_is_refused():
    with pytest.raises(InputError, match="given twice: left_hip"):
        layout_from_names(["left_hip", "left_hip"])


@pytest.mark.parametrize("parents", [(0,), (-1, 2), (-2, 0)])
def test_parents_must_be_indices(parents):
    with pytest.raises(ValueError, match="layout 'x'"):
        Layout("x", ("a", "b"), parents)


def test_a_joint_that_is_not_there_is_a_key_error():
    with pytest.raises(KeyError, match="tail"):
        LAYOUTS["coco_17"].index("tail")
