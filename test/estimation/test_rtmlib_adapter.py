"""rtmlib with small networks of the form of RTMO, YOLOX and RTMPose, from a folder."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("onnx")
pytest.importorskip("rtmlib", reason='rtmlib is not installed: pip install "stcalib-ros[rtmlib]"')

from networks import constant_network

from stcalib_ros.core.errors import InputError
from stcalib_ros.estimation.registry import load_estimator

IMAGE = np.full((320, 640, 3), 100, np.uint8)


def rtmo(path, box_scores: list[float]) -> np.ndarray:
    """Write a network that finds a person for each score, 100 px apart; return their joints."""
    boxes = np.zeros((1, len(box_scores), 5))
    joints = np.zeros((1, len(box_scores), 17, 3))
    for k, score in enumerate(box_scores):
        boxes[0, k] = (100 * k, 20, 100 * k + 60, 200, score)
        joints[0, k, :, 0] = 100 * k + np.arange(17)
        joints[0, k, :, 1] = 20 + 10 * np.arange(17)
        joints[0, k, :, 2] = 0.8
    constant_network(path, {"dets": boxes, "keypoints": joints}, 640)
    return joints


def test_rtmo_gives_persons_in_pixels_of_the_image(tmp_path, capsys):
    joints = rtmo(tmp_path / "rtmo.onnx", [0.9, 0.8])
    poses = load_estimator("rtmo", folder=tmp_path).poses(IMAGE)
    np.testing.assert_allclose(poses.keypoints, joints[0, :, :, :2])
    assert poses.scores == pytest.approx(0.8)
    assert np.isnan(poses.joints).all()
    assert poses.joints.shape == (2, 17, 3)
    assert capsys.readouterr().out == ""


def test_nobody_is_an_empty_answer_of_rtmo(tmp_path):
    rtmo(tmp_path / "rtmo.onnx", [0.1])
    poses = load_estimator("rtmo", folder=tmp_path).poses(IMAGE)
    assert poses.keypoints.shape == (0, 17, 2)


@pytest.mark.parametrize(("score", "persons"), [(0.9, 1), (0.1, 0)])
def test_rtmpose_finds_joints_of_the_persons_of_its_detector_alone(score, persons, tmp_path):
    boxes = np.array([[[100.0, 20.0, 250.0, 220.0, score]]])
    constant_network(tmp_path / "rtmpose-detector.onnx", {"dets": boxes}, 640)
    along_x, along_y = np.zeros((1, 17, 384)), np.zeros((1, 17, 512))
    along_x[..., 192] = along_y[..., 256] = 0.7
    constant_network(tmp_path / "rtmpose.onnx", {"simcc_x": along_x, "simcc_y": along_y}, "side")
    poses = load_estimator("rtmpose", folder=tmp_path).poses(IMAGE)
    assert len(poses.scores) == persons
    np.testing.assert_allclose(poses.keypoints, np.tile((175.0, 120.0), (persons, 17, 1)))


def test_a_file_that_is_no_network_is_named(tmp_path):
    (tmp_path / "rtmo.onnx").write_bytes(b"nothing")
    with pytest.raises(InputError, match=r"rtmlib cannot load .*rtmo\.onnx"):
        load_estimator("rtmo", folder=tmp_path)


def test_a_size_is_refused(tmp_path):
    with pytest.raises(InputError, match="rtmo takes no size of its input, got 256"):
        load_estimator("rtmo", size=256, folder=tmp_path)
