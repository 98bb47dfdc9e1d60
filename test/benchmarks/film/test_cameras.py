"""The cameras of the film."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.film.cameras import CAMERAS, truth
from benchmarks.film.room import HALF_DEPTH_M, HALF_WIDTH_M, HEIGHT_M
from stcalib_ros.core.geometry.lens import project


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.name)
def test_every_camera_is_in_the_room_upright_and_looks_at_its_middle(camera) -> None:
    R, t = camera.pose
    assert np.all(np.abs(camera.eye) < [HALF_WIDTH_M, HALF_DEPTH_M, HEIGHT_M])
    assert np.allclose(R @ R.T, np.eye(3))
    assert np.linalg.det(R) > 0
    feet, head = project(np.array([[0, 0, 0.0], [0, 0, 1.8]]) @ R.T + t, camera.lens)
    assert head[1] < feet[1]
    for point in (feet, head):
        assert np.all((point > 0) & (point < [camera.lens.width, camera.lens.height]))


def test_stamps_start_at_zero_and_only_one_camera_has_uneven_ones() -> None:
    uneven = []
    for camera in CAMERAS:
        stamps = camera.stamps(10.0)
        assert stamps[0] == 0.0
        assert 110 <= len(stamps) <= 170
        if np.ptp(np.diff(stamps)) > 1e-9:
            uneven.append(camera.name)
    assert uneven == ["cam4"]


def test_a_shorter_film_is_the_begin_of_a_longer_one() -> None:
    for camera in CAMERAS:
        short, long = camera.ticks(3.0), camera.ticks(24.0)
        assert np.array_equal(short, long[: len(short)])


def test_truth_turns_points_of_a_camera_into_the_frame_of_the_first() -> None:
    calibration = truth(24.0)
    point = np.array([0.3, -0.7, 1.1])
    R, t = CAMERAS[0].pose
    for camera, one in zip(CAMERAS, calibration.cameras, strict=True):
        R_cam, t_cam = camera.pose
        in_camera = R_cam @ point + t_cam
        assert np.allclose(one.R_ref_cam @ in_camera + one.t_ref_cam, R @ point + t)
    assert calibration.cameras[0].time_offset_s == 0.0
