"""Errors of lenses against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from stcalib_ros.core.evaluation.lens_errors import lens_error, ray_alignment
from stcalib_ros.core.evaluation.metrics import evaluate
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.core.synthetic import SceneOptions, simulate

TRUTH = simulate(SceneOptions(n_frames=10, n_people=1)).truth


def pinhole(focal_px, *, middle=(320.0, 240.0), D=(), model=LensModel.PLUMB_BOB):
    K = np.array([[focal_px, 0, middle[0]], [0, focal_px, middle[1]], [0, 0, 1.0]])
    return Intrinsics(640, 480, model, K, np.array(D))


def error(estimate, truth):
    camera = TRUTH.cameras[0]
    return lens_error(replace(camera, intrinsics=estimate), replace(camera, intrinsics=truth))


def test_focal_length_and_principal_point():
    found = error(pinhole(515.0, middle=(323.0, 236.0)), pinhole(500.0))
    assert found.focal == pytest.approx(0.03)
    assert found.principal_point_px == pytest.approx(5.0)
    assert found.radial == (0.0, 0.0)


def test_coefficients_that_are_not_there_are_zero():
    found = error(pinhole(500.0), pinhole(500.0, D=(-0.12, 0.03, 0.0, 0.0, 0.0)))
    assert found.radial == pytest.approx((0.12, -0.03))


def test_a_small_shift_of_the_image_is_a_rotation():
    """A narrow lens cannot tell its principal point from where it looks."""
    narrow = error(pinhole(20_000.0, middle=(330.0, 240.0)), pinhole(20_000.0))
    assert narrow.principal_point_px == pytest.approx(10.0)
    assert narrow.ray_rad < 1e-3 * 10.0 / 20_000.0


def test_rays_grow_with_the_angle_to_the_axis():
    """To first order a longer focal length brings rays at tan a nearer by d sin a cos a."""
    truth = pinhole(500.0, middle=(319.5, 239.5))
    found = error(pinhole(500.0 * 1.001, middle=(319.5, 239.5)), truth)
    u, v = np.meshgrid(np.linspace(-319.5, 319.5, 400), np.linspace(-239.5, 239.5, 400))
    angle = np.arctan(np.hypot(u, v) / 500.0)
    expected = 1e-3 * np.sqrt(np.mean((np.sin(angle) * np.cos(angle)) ** 2))
    assert found.ray_rad == pytest.approx(expected, rel=0.1)


def test_models_are_compared_by_their_rays_alone():
    fisheye = pinhole(500.0, D=(0.0, 0.0, 0.0, 0.0), model=LensModel.EQUIDISTANT)
    found = error(fisheye, pinhole(500.0))
    assert np.isnan(found.radial).all()
    assert 0.01 < found.ray_rad < 0.1


def test_only_estimated_lenses_count_in_the_means():
    off = replace(TRUTH.cameras[1].intrinsics, K=TRUTH.cameras[1].intrinsics.K * [1.02, 1.02, 1])
    known = (LensKnowledge.GIVEN, LensKnowledge.UNKNOWN, LensKnowledge.REFINE, LensKnowledge.GIVEN)
    lenses = [off, off, TRUTH.cameras[2].intrinsics, TRUTH.cameras[3].intrinsics]
    cameras = tuple(
        replace(c, intrinsics=lens, lens_knowledge=knowledge)
        for c, lens, knowledge in zip(TRUTH.cameras, lenses, known, strict=True)
    )
    found = evaluate(replace(TRUTH, cameras=cameras), TRUTH)
    assert [lens.estimated for lens in found.lenses] == [False, True, True, False]
    assert found.lenses[0].focal == pytest.approx(0.02)
    assert found.E_f == pytest.approx(0.01)
    assert found.E_k1 == 0.0


def test_there_is_no_mean_of_given_lenses():
    found = evaluate(TRUTH, TRUTH)
    assert np.isnan([found.E_f, found.E_k1]).all()
    assert [lens.focal for lens in found.lenses] == [0.0] * 4


def test_a_principal_point_that_is_off_is_a_rotation_of_the_rays():
    """All cameras look elsewhere, by as much as their principal points are off."""
    off = np.array([[0, 0, 30.0], [0, 0, -20.0], [0, 0, 0]])
    cameras = []
    for camera in TRUTH.cameras:
        lens = replace(camera.intrinsics, K=camera.intrinsics.K + off)
        Q, rms = ray_alignment(lens, camera.intrinsics)
        assert 0.0 < rms < 0.15 * np.hypot(30.0, 20.0) / 1400.0
        cameras.append(replace(camera, intrinsics=lens, R_ref_cam=camera.R_ref_cam @ Q))
    first = cameras[0].R_ref_cam
    moved = [
        replace(c, R_ref_cam=first.T @ c.R_ref_cam, t_ref_cam=first.T @ c.t_ref_cam)
        for c in cameras
    ]
    found = evaluate(replace(TRUTH, cameras=tuple(moved)), TRUTH)
    assert min(found.E_R, found.E_t) > 0.01
    assert max(found.E_R_rays, found.E_t_rays) < 1e-6


def test_with_true_lenses_rays_are_turned_as_the_cameras_are():
    turned = replace(
        TRUTH.cameras[2], R_ref_cam=TRUTH.cameras[2].R_ref_cam @ exp_so3(np.array([0, 0.03, 0]))
    )
    found = evaluate(replace(TRUTH, cameras=(*TRUTH.cameras[:2], turned)), TRUTH)
    assert found.E_R_rays == pytest.approx(found.E_R) == pytest.approx(0.015)
