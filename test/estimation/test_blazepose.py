"""BlazePose: regions of persons, the way of their joints back to the image, heat maps.

The network is a stand-in for LiteRT's interpreter: it finds marks of three colours in its crop.
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.estimation.blazepose import BlazePose, refined, regions
from stcalib_ros.estimation.poses import ImagePoses

SIDE = 256
COCO = LAYOUTS["coco_17"]
LAYOUT = LAYOUTS["blazepose_33"]


class MarkFinder:
    """Joint 0 at the blue mark, 1 at the green, 2 at the red; in 3D along x, y and z."""

    def __init__(self, path: str, num_threads: int) -> None:
        self.outputs: list[np.ndarray] = []

    def allocate_tensors(self) -> None:
        """Nothing to do."""

    def get_input_details(self):
        return [{"index": 0, "shape": np.array([1, SIDE, SIDE, 3])}]

    def get_output_details(self):
        return [{"index": k} for k in range(5)]

    def set_tensor(self, index: int, values: np.ndarray) -> None:
        landmarks = np.zeros((39, 5), np.float32)
        for joint, channel in enumerate((2, 1, 0)):  # the crop has red first
            weights = values[0, :, :, channel]
            rows, columns = np.mgrid[:SIDE, :SIDE] + 0.5
            total = max(weights.sum(), 1e-9)
            landmarks[joint, :2] = (columns * weights).sum() / total, (rows * weights).sum() / total
        landmarks[:33, 3] = 3.0
        world = np.zeros((39, 3), np.float32)
        world[0, 0] = world[1, 1] = world[2, 2] = 1.0
        heat = np.full((1, 64, 64, 39), -20.0, np.float32)
        person = np.array([[0.9 if values.any() else 0.1]], np.float32)
        self.outputs = [landmarks.reshape(1, -1), person, heat[..., :1], heat, world.reshape(1, -1)]

    def invoke(self) -> None:
        """Nothing to do."""

    def get_tensor(self, index: int) -> np.ndarray:
        return self.outputs[index]


def person(middle: tuple[float, float], angle: float) -> ImagePoses:
    """Somebody of 200 px, turned clockwise by an angle."""
    keypoints = np.full((1, 17, 2), np.nan)
    keypoints[:] = middle
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for name, offset in {"hip": (10, 0), "shoulder": (20, -60), "ankle": (10, 100)}.items():
        for side, sign in (("left", 1), ("right", -1)):
            place = turn @ np.array([sign * offset[0], offset[1]])
            keypoints[0, COCO.index(f"{side}_{name}")] = np.add(middle, place)
    return ImagePoses(keypoints, np.ones((1, 17)), np.full((1, 17, 3), np.nan))


@pytest.fixture
def load(monkeypatch):
    monkeypatch.setitem(
        sys.modules, "ai_edge_litert.interpreter", SimpleNamespace(Interpreter=MarkFinder)
    )

    def load(found: ImagePoses) -> BlazePose:
        return BlazePose(Path("none"), SimpleNamespace(poses=lambda image: found))  # type: ignore[arg-type]

    return load


@pytest.mark.parametrize("angle", [0.0, 0.6, np.pi / 2, -2.0])
def test_a_region_surrounds_a_person_however_they_are_turned(angle):
    (region,) = regions(person((300.0, 200.0), angle))
    np.testing.assert_allclose(region.centre, (300.0, 200.0), atol=1e-9)
    assert region.angle == pytest.approx(angle)
    assert region.side == pytest.approx(2.75 * np.hypot(10, 100))


def test_joints_that_are_hardly_seen_make_no_region():
    poses = person((300.0, 200.0), 0.0)
    weak = np.full_like(poses.scores, 0.1)
    assert regions(ImagePoses(poses.keypoints, weak, poses.joints)) == []


@pytest.mark.parametrize("angle", [0.0, 0.6, np.pi / 2])
def test_joints_come_back_to_their_pixels_and_axes(angle, load):
    marks = np.array([[320.0, 210.0], [270.0, 260.0], [330.0, 140.0]])
    image = np.zeros((480, 640, 3), np.uint8)
    for channel, mark in enumerate(marks):
        colour = np.zeros(3)
        colour[channel] = 255
        cv2.circle(image, tuple(mark.astype(int).tolist()), 6, colour.tolist(), -1)
    poses = load(person((300.0, 200.0), angle)).poses(image)
    assert poses.keypoints.shape == (1, 33, 2)
    np.testing.assert_allclose(poses.keypoints[0, :3], marks, atol=0.2)
    expected = [
        (np.cos(angle), np.sin(angle), 0.0),
        (-np.sin(angle), np.cos(angle), 0.0),
        (0.0, 0.0, 1.0),
    ]
    np.testing.assert_allclose(poses.joints[0, :3], expected, atol=1e-6)
    assert poses.scores[0] == pytest.approx(1.0 / (1.0 + np.exp(-3.0)))


def test_a_region_without_a_person_is_left_out(load):
    poses = load(person((300.0, 200.0), 0.0)).poses(np.zeros((480, 640, 3), np.uint8))
    assert poses.keypoints.shape == (0, 33, 2)
    assert poses.joints.shape == (0, 33, 3)
    assert load(person((0.0, 0.0), 0.0)).layout == LAYOUT


def test_heat_maps_refine_joints_where_there_is_heat():
    heat = np.full((64, 64, 2), -20.0)
    heat[30, 42, 0] = 8.0
    points = np.array([[40.5 / 64, 31.5 / 64], [0.2, 0.2]])
    result = refined(points, heat)
    np.testing.assert_allclose(result[0], (42 / 64, 30 / 64), atol=1e-4)
    np.testing.assert_array_equal(result[1], points[1])
    outside = np.array([[1.2, 0.5], [-0.1, 0.5]])
    np.testing.assert_array_equal(refined(outside, heat), outside)
