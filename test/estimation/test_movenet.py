"""MoveNet: pixels, scores, and persons that are found twice."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

from networks import brightest_pixel_movenet

from stcalib_ros.core.errors import InputError
from stcalib_ros.estimation.movenet import MoveNet, distinct
from stcalib_ros.estimation.registry import load_estimator
from stcalib_ros.estimation.weights import MOVENET, are_fetched

ONE = [0.9, 0.1, 0.1, 0.1, 0.1, 0.1]


@pytest.mark.parametrize("size", [256, 512])
def test_marks_are_found_without_a_bias(size, tmp_path):
    estimator = MoveNet(brightest_pixel_movenet(tmp_path / "small.onnx", ONE), size=size)
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(40):
        image = np.zeros((480, 640, 3), np.uint8)
        x, y = rng.uniform(40, 600), rng.uniform(40, 440)
        rows, columns = np.mgrid[:480, :640]
        distance = np.hypot(columns - x, rows - y)
        image[...] = (255 * np.clip(1.0 - distance / 40.0, 0.0, 1.0))[..., None].astype(np.uint8)
        poses = estimator.poses(image)
        assert poses.keypoints.shape == (1, 17, 2)
        errors.append(poses.keypoints[0, 0] - (x, y))
    assert np.abs(np.mean(errors, axis=0)).max() < 0.35
    assert np.abs(errors).max() < 2 * 640 / size


def test_2d_alone_and_the_score_of_joints(tmp_path):
    estimator = MoveNet(brightest_pixel_movenet(tmp_path / "small.onnx", ONE))
    poses = estimator.poses(np.zeros((48, 64, 3), np.uint8))
    assert poses.scores == pytest.approx(0.9)
    assert np.isnan(poses.joints).all()
    assert poses.joints.shape == (1, 17, 3)


def test_nobody_is_an_empty_answer(tmp_path):
    estimator = MoveNet(brightest_pixel_movenet(tmp_path / "small.onnx", [0.1] * 6))
    poses = estimator.poses(np.zeros((48, 64, 3), np.uint8))
    assert poses.keypoints.shape == (0, 17, 2)
    assert poses.joints.shape == (0, 17, 3)


def test_a_person_found_twice_is_one_and_two_who_cross_are_two():
    rng = np.random.default_rng(0)
    person = rng.uniform(0.0, 1.0, (17, 2)) * (60, 200)
    mirrored = (60 - person[:, 0], person[:, 1])
    persons = np.stack([person, person + rng.normal(0, 4, (17, 2)), np.column_stack(mirrored)])
    assert distinct(persons) == [0, 2]
    assert distinct(np.stack([person, person + np.array([40, 0])])) == [0, 1]
    assert distinct(np.empty((0, 17, 2))) == []


def test_a_size_out_of_range_and_a_file_that_is_none_are_refused(tmp_path):
    path = brightest_pixel_movenet(tmp_path / "small.onnx", ONE)
    with pytest.raises(InputError, match="expected 128 to 1024, got 64"):
        MoveNet(path, size=64)
    path.write_bytes(b"nothing")
    with pytest.raises(InputError, match="cannot read the network"):
        MoveNet(path)


@pytest.mark.skipif(not are_fetched(MOVENET), reason="no weights: stcalib models fetch movenet")
def test_the_real_network_finds_nobody_in_noise():
    noise = np.random.default_rng(0).integers(0, 255, (480, 640, 3), np.uint8)
    assert len(load_estimator("movenet").poses(noise).scores) == 0
