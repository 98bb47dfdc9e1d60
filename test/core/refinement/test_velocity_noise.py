"""Cameras side by side: their poses without what noise of the velocities does to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.recording import Intrinsics, LensModel, keypoints_only
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.core.synthetic.rigs import SceneRig


def row(n, distance):
    """Cameras beside each other that look along parallel axes at people 4.5 m away."""
    K = np.array([[1400, 0, 960], [0, 1400, 540], [0, 0, 1.0]])
    lens = Intrinsics(1920, 1080, LensModel.PLUMB_BOB, K, np.zeros(5))
    R = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])
    centres = np.array([[distance * (i - (n - 1) / 2), -4.5, 1.0] for i in range(n)])
    names = tuple(f"cam{i}" for i in range(n))
    return SceneRig(names, (lens,) * n, np.tile(R, (n, 1, 1)), -centres @ R.T)


@pytest.fixture(scope="module")
def scene():
    options = SceneOptions(
        seed=8, rig=row(4, 0.3), people="procedural", flip_rate=0.0, id_switches_per_10s=0.0
    )
    return simulate(options)


@pytest.fixture(scope="module")
def found(scene):
    return calibrate(keypoints_only(scene.recording))


def test_cameras_in_a_row_keep_their_deviations(scene, found):
    assert found.status is Status.OK
    for one, true in zip(found.cameras[1:], scene.truth.cameras[1:], strict=True):
        off = rotation_angle(one.R_ref_cam.T @ true.R_ref_cam)
        assert off < 2.0 * np.sqrt(np.linalg.eigvalsh(one.covariance[3:, 3:])[-1])


def test_the_order_of_cameras_does_not_matter(scene, found):
    recording = keypoints_only(scene.recording)
    turned = calibrate(replace(recording, cameras=recording.cameras[::-1]))
    one = {camera.name: camera for camera in found.cameras}
    other = {camera.name: camera for camera in turned.cameras}
    assert one.keys() == other.keys()
    for name in ("cam1", "cam2"):
        before = one["cam3"].R_ref_cam.T @ one[name].R_ref_cam
        after = other["cam3"].R_ref_cam.T @ other[name].R_ref_cam
        deviation = np.sqrt(np.linalg.eigvalsh(other[name].covariance[3:, 3:])[-1])
        assert rotation_angle(before.T @ after) < 0.5 * deviation
