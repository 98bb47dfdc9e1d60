"""Up and the floor, from people whose world is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS, layout_from_names
from stcalib_ros.core.output.gravity import body_up, find_upright, leg_length
from stcalib_ros.core.synthetic.people import make_people
from stcalib_ros.core.synthetic.skeleton import LAYOUT, body_axes

TIMES = np.arange(0, 20, 1 / 15)
SECOND = 15


def walkers(n: int = 3, seed: int = 0) -> list[np.ndarray]:
    """Joints in a world with z up and the floor at 0."""
    people = make_people(np.random.default_rng(seed), "procedural", n, (0.0, 20.0), 2.0, ())
    return [person(TIMES) for person in people]


def seen_from(R_world_ref: np.ndarray, height: float, people: list[np.ndarray]) -> list[np.ndarray]:
    """The same in the frame of a camera above the origin."""
    return [(joints - [0.0, 0.0, height]) @ R_world_ref for joints in people]


def camera(yaw: float, pitch: float, roll: float) -> np.ndarray:
    """R_world_ref of a camera; all zero: level, and looking along x."""
    level = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    turn = exp_so3(np.array([0.0, 0.0, yaw])) @ exp_so3(np.array([0.0, pitch, 0.0]))
    return np.asarray(turn @ level @ exp_so3(np.array([0.0, 0.0, roll])))


@settings(max_examples=15, deadline=None)
@given(
    yaw=st.floats(-3, 3), pitch=st.floats(-1, 1), roll=st.floats(-3, 3), height=st.floats(0.3, 6)
)
def test_the_camera_is_found_in_its_world(yaw, pitch, roll, height):
    upright, complaint = find_upright(
        LAYOUT, seen_from(camera(yaw, pitch, roll), height, walkers()), block=SECOND
    )
    assert complaint == ""
    # x is where the camera looks: its yaw is gone.
    R = camera(0.0, pitch, roll)
    angle = np.linalg.norm(upright.R_world_ref - R) / np.sqrt(2)
    deviation = np.sqrt(np.trace(upright.covariance[:2, :2]))
    assert angle < min(4 * deviation, np.radians(2.5)) / np.cos(pitch)
    assert upright.height == pytest.approx(height, abs=0.08)


@pytest.mark.parametrize("pitch", [-np.pi / 2, np.pi / 2])
def test_the_heading_of_a_camera_that_looks_down_or_up_is_not_noise(pitch):
    """A camera at the ceiling or on the floor, and the same one tipped by a thousandth."""
    headings = []
    for tip in (-1e-3, 0.0, 1e-3):
        R = exp_so3(np.array([tip, tip, 0.0])) @ camera(0.5, pitch, 0.0)
        upright, _ = find_upright(LAYOUT, seen_from(R, 2.5, walkers()), block=SECOND)
        headings.append(upright.R_world_ref)
    for R in headings:
        assert np.linalg.norm(R - headings[1]) < 0.05
    # Its image's vertical is along x.
    assert abs(headings[1][0, 1]) == pytest.approx(1.0, abs=0.01)


def test_lengths_may_have_any_unit():
    people = seen_from(camera(0.3, 0.2, 0.0), 2.0, walkers())
    metres, _ = find_upright(LAYOUT, people, block=SECOND)
    inches, _ = find_upright(LAYOUT, [p / 0.0254 for p in people], block=SECOND)
    np.testing.assert_allclose(inches.R_world_ref, metres.R_world_ref, atol=1e-9)
    assert inches.height * 0.0254 == pytest.approx(metres.height)
    assert inches.covariance[2, 2] * 0.0254**2 == pytest.approx(metres.covariance[2, 2])


def test_leaning_forward_cancels_when_people_look_all_ways():
    """Turning on the spot, ten degrees forward: up is right; looking one way only, it is not."""
    lean = exp_so3(np.array([0.0, np.radians(10), 0.0]))
    pose = walkers(1)[0][0]
    leaning = (pose - pose[0]) @ body_axes(pose).T @ lean.T
    yaw = np.linspace(0, 2 * np.pi, len(TIMES), endpoint=False)
    turning = np.stack([leaning @ exp_so3(np.array([0.0, 0.0, y])).T for y in yaw])
    still = np.repeat(leaning[None], len(TIMES), axis=0)
    tilt = [
        np.degrees(np.arccos(body_up(LAYOUT, [path], block=SECOND)[0][2]))
        for path in (turning, still)
    ]
    assert tilt[0] < 2.0
    assert tilt[1] > 7.0


def test_one_who_stands_on_a_table_does_not_lift_the_floor():
    people = walkers(3)
    on_table = people[2] + [0.0, 0.0, 0.7]
    upright, _ = find_upright(
        LAYOUT, seen_from(camera(0, 0.3, 0), 2.0, [*people[:2], on_table]), block=SECOND
    )
    assert upright.height == pytest.approx(2.0, abs=0.1)
    assert np.degrees(np.arccos(upright.R_world_ref[2] @ camera(0, 0.3, 0)[2])) < 2.0


def test_the_deviation_grows_when_nobody_walks_about():
    walking = seen_from(camera(0, 0.3, 0), 2.0, walkers())
    standing = [p - p[:, :1] * [1, 1, 0] for p in walkers()]
    narrow, _ = find_upright(LAYOUT, walking, block=SECOND)
    wide, _ = find_upright(LAYOUT, seen_from(camera(0, 0.3, 0), 2.0, standing), block=SECOND)
    assert np.trace(wide.covariance[:2, :2]) > 2 * np.trace(narrow.covariance[:2, :2])


def test_gaps_do_no_harm():
    people = seen_from(camera(0.5, 0.3, 0.1), 2.0, walkers())
    rng = np.random.default_rng(0)
    gappy = [np.where(rng.uniform(size=p.shape[:2])[..., None] < 0.3, np.nan, p) for p in people]
    whole, _ = find_upright(LAYOUT, people, block=SECOND)
    holes, _ = find_upright(LAYOUT, gappy, block=SECOND)
    assert np.degrees(np.arccos(np.clip(whole.R_world_ref[2] @ holes.R_world_ref[2], -1, 1))) < 1.0


def test_people_in_all_postures_tell_nothing():
    rng = np.random.default_rng(1)
    tumbling = [p @ exp_so3(rng.uniform(-3, 3, 3)).T for p in walkers(8)]
    upright, complaint = find_upright(LAYOUT, tumbling, block=SECOND)
    assert upright is None
    assert "not upright" in complaint


@pytest.mark.parametrize("people", [[], [np.full((30, 17, 3), np.nan)]])
def test_nobody_tells_nothing(people):
    upright, complaint = find_upright(LAYOUT, people, block=SECOND)
    assert upright is None
    assert "nobody" in complaint


def test_a_layout_without_legs_tells_nothing():
    layout = layout_from_names(["nose", "left_shoulder", "right_shoulder", "left_wrist"])
    assert find_upright(layout, [np.ones((30, 4, 3))], block=SECOND)[0] is None


def test_legs_are_measured_along_their_bones():
    joints = walkers(1)[0]
    right = [LAYOUT.index(f"right_{n}") for n in ("hip", "knee", "ankle")]
    left = [LAYOUT.index(f"left_{n}") for n in ("hip", "knee", "ankle")]
    expected = np.mean(
        [np.linalg.norm(np.diff(joints[0, leg], axis=0), axis=-1).sum() for leg in (left, right)]
    )
    assert leg_length(LAYOUT, joints) == pytest.approx(expected)
    assert np.isnan(leg_length(LAYOUTS["coco_17"], np.full((3, 17, 3), np.nan)))
