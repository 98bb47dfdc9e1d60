"""Errors of lenses against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from stcalib_ros.core.evaluation.lens_errors import lens_error
from stcalib_ros.core.evaluation.metrics import evaluate
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
