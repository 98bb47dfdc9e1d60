"""Pictures of people in the images of cameras."""

from __future__ import annotations

import numpy as np
import pytest

import stcalib_ros as st
from stcalib_ros.core.capture.reprojection import ImageOfPeople
from stcalib_ros.report.overlay import WIDTH_PX, mosaic

CAMERAS = st.simulate(st.SceneOptions(n_cameras=3, n_people=1, n_frames=2)).truth.cameras


def image_of(camera: st.CameraCalibration, point: tuple[float, float]) -> ImageOfPeople:
    joints = np.array([point, (np.nan, np.nan)])
    return ImageOfPeople(camera, 0.0, 1.0, {0: joints}, np.zeros((0, 2, 2)), 1.0, 2)


@pytest.mark.parametrize("shape", [(480, 640), (960, 540)])
def test_a_joint_is_drawn_where_it_is(shape: tuple[int, int]) -> None:
    black = np.zeros((*shape, 3), np.uint8)
    points = [(100.0, 400.0), (300.0, 200.0)]
    shown = [(image_of(c, p), black) for c, p in zip(CAMERAS, points, strict=False)]
    picture = mosaic(shown, [(0, 1)], 0.0, [camera.name for camera in CAMERAS[:2]])
    assert picture.shape[1] <= WIDTH_PX
    assert all(side % 2 == 0 for side in picture.shape[:2])
    yellow = (picture == (0, 196, 245)).all(-1)
    half = picture.shape[1] // 2
    for k, point in enumerate(points):
        part = yellow[:, k * half : (k + 1) * half]
        rows, columns = np.nonzero(part)
        scale = (picture.shape[0] - 34) / shape[0]
        low = rows > rows.min() + 40  # below the name
        assert rows[low].mean() == pytest.approx(34 + scale * point[1], abs=4)
        assert np.ptp(columns[low]) <= 10


def test_a_camera_without_an_image_keeps_its_place() -> None:
    names = [camera.name for camera in CAMERAS]
    black = np.zeros((480, 640, 3), np.uint8)
    whole = mosaic([(image_of(c, (9.0, 9.0)), black) for c in CAMERAS], [], 0.0, names)
    part = mosaic([(image_of(CAMERAS[1], (9.0, 9.0)), black)], [], 0.0, names)
    assert part.shape == whole.shape
