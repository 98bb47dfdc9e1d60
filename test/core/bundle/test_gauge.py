"""Cameras at one place: no unit of length depends on which two come first."""

from __future__ import annotations

import numpy as np
import pytest
from core_helpers import SMALL

from stcalib_ros.core.bundle.gauge import camera_centres, spread
from stcalib_ros.core.geometry.so3 import exp_so3, rotation_angle
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.core.synthetic.rigs import SceneRig
from stcalib_ros.io.mocap import shipped_clips


def test_the_spread_grows_with_the_scene_and_not_with_its_place(rng):
    R, centres = exp_so3(rng.normal(size=(4, 3))), rng.normal(size=(4, 3))
    t = -np.einsum("cij,cj->ci", R, centres)
    np.testing.assert_allclose(camera_centres(R, t), centres, atol=1e-12)
    assert spread(3.0 * centres + 7.0) == pytest.approx(3.0 * spread(centres))


def looking_inwards(centres, targets):
    """Rotations (C, 3, 3) to cameras that are level with the horizon."""
    ahead = (targets - centres) / np.linalg.norm(targets - centres, axis=-1, keepdims=True)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    return np.stack([right, np.cross(ahead, right), ahead], 1)


def test_a_rig_whose_first_two_cameras_share_a_place_is_calibrated():
    lens = simulate(SMALL).recording.cameras[0].intrinsics
    centres = np.array([[4, 0, 1.6], [4, 0, 1.6], [-1, 4, 1.8], [-3, -3, 1.5]])
    R = looking_inwards(centres, np.array([[0, -0.5, 1], [0, 0.5, 1], [0, 0, 1], [0, 0, 1.0]]))
    t = -np.einsum("cij,cj->ci", R, centres)
    rig = SceneRig(("cam0", "cam1", "cam2", "cam3"), (lens,) * 4, R, t)
    scene = simulate(SceneOptions(seed=1, rig=rig, n_cameras=4), clips=shipped_clips())
    found = calibrate(scene.recording)
    assert found.status is Status.OK
    assert np.isfinite(found.joint_covariance).all()
    for one, true in zip(found.cameras, scene.truth.cameras, strict=True):
        assert rotation_angle(one.R_ref_cam.T @ true.R_ref_cam) < 1e-3
    assert np.linalg.norm(found.cameras[1].t_ref_cam) < 0.01
