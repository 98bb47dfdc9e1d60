"""Residuals by the angle from the optical axis: closed forms of wrong lenses."""

from __future__ import annotations

import numpy as np
import pytest

from stcalib_ros.core.geometry.lens import bearings, project
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.report.angles import errors_by_angle
from stcalib_ros.report.content import ReportContent
from stcalib_ros.report.fits import KeypointFit, camera_fits
from stcalib_ros.report.image_plane import angle_axis, angle_chart

ANGLES_DEG = np.array([2.5, 7.5, 12.5, 17.5, 22.5, 27.5])
PER_RING = 120


def lens_of(focal: float, *, model: LensModel = LensModel.PLUMB_BOB, k1: float = 0.0) -> Intrinsics:
    K = np.array([[focal, 0.0, 320.0], [0.0, focal, 240.0], [0.0, 0.0, 1.0]])
    return Intrinsics(640, 480, model, K, np.array([k1, 0.0, 0.0, 0.0]))


def rings() -> np.ndarray:
    """Rays (M, 3): a ring at the middle of each range of angles."""
    r = np.repeat(np.tan(np.radians(ANGLES_DEG)), PER_RING)
    turn = np.tile(np.linspace(0.0, 2.0 * np.pi, PER_RING, endpoint=False), len(ANGLES_DEG))
    return np.stack([r * np.cos(turn), r * np.sin(turn), np.ones_like(r)], -1)


def fit_by(true: Intrinsics, given: Intrinsics) -> KeypointFit:
    """What is left where only the lens is wrong: joints and pose are the true ones."""
    rays = rings()
    pixels = project(rays, true)
    x, focal = bearings(pixels, given)
    residuals = (rays[:, :2] - x) * focal[:, None]
    n = len(rays)
    return KeypointFit("cam0", n, n, pixels, residuals, np.ones(n, bool), 1.0, 1.0, 300.0)


def test_a_focal_length_too_large_projects_outwards_by_its_share_of_the_radius() -> None:
    given = lens_of(505.0)
    found = errors_by_angle(fit_by(lens_of(500.0), given), given)
    assert found.angle_deg == pytest.approx(ANGLES_DEG)
    assert found.counts.tolist() == [PER_RING] * len(ANGLES_DEG)
    expected = 0.01 * 500.0 * np.tan(np.radians(ANGLES_DEG))
    assert found.outward_px == pytest.approx(np.repeat(expected[:, None], 3, axis=1), abs=1e-6)
    assert found.error_px == pytest.approx(found.outward_px, abs=1e-6)


@pytest.mark.parametrize("model", [LensModel.PLUMB_BOB, LensModel.EQUIDISTANT])
def test_pixels_are_those_of_the_image_whatever_the_lens(model: LensModel) -> None:
    true, given = lens_of(400.0, model=model, k1=0.05), lens_of(400.0, model=model)
    found = errors_by_angle(fit_by(true, given), given)
    t = np.tan(np.radians(ANGLES_DEG)) if model is LensModel.PLUMB_BOB else np.radians(ANGLES_DEG)
    # To first order: the residual on the plane z = 1 is small.
    assert found.outward_px[:, 1] == pytest.approx(-400.0 * 0.05 * t**3, rel=0.03, abs=1e-4)


def test_a_shift_has_no_outward_part_but_an_error() -> None:
    lens = lens_of(500.0)
    fit = fit_by(lens, lens)
    fit.residuals[:] = [3.0, 4.0]
    found = errors_by_angle(fit, lens)
    assert found.error_px == pytest.approx(np.full((len(ANGLES_DEG), 3), 5.0), abs=1e-6)
    assert np.abs(found.outward_px[:, 1]).max() < 0.5
    assert (found.outward_px[:, 0] < -3.0).all()
    assert (found.outward_px[:, 2] > 3.0).all()


def test_keypoints_that_do_not_fit_and_thin_rings_are_not_shown() -> None:
    lens = lens_of(500.0)
    fit = fit_by(lens, lens)
    fit.fits[:PER_RING] = False
    fit.pixels[-40:] = np.nan
    found = errors_by_angle(fit, lens)
    assert found.angle_deg == pytest.approx(ANGLES_DEG[1:-1])
    fit.fits[:] = False
    nobody = errors_by_angle(fit, lens)
    assert nobody.counts.tolist() == []
    assert nobody.error_px.shape == (0, 3)
    assert "cam0" in angle_chart(nobody, "#000", angle_axis([nobody]))


def test_the_chart_says_how_many_keypoints_there_are() -> None:
    lens = lens_of(505.0)
    found = errors_by_angle(fit_by(lens_of(500.0), lens), lens)
    axis = angle_axis([found])
    assert axis.low < 0.0 < found.error_px.max() < axis.high
    assert angle_chart(found, "#0072B2", axis).count(f">{PER_RING}</span>") == len(ANGLES_DEG)


def test_right_lenses_of_a_calibrated_scene_stay_near_zero(report_content: ReportContent) -> None:
    lenses = {camera.name: camera.intrinsics for camera in report_content.calibration.cameras}
    for fit in camera_fits(report_content.evidence, list(lenses)):
        found = errors_by_angle(fit, lenses[fit.name])
        assert len(found.counts) >= 3
        assert found.counts.sum() > 0.8 * fit.fits.sum()
        assert np.abs(found.outward_px[:, 1]).max() < 0.3
        assert found.error_px[:, 1].mean() == pytest.approx(fit.median_px, rel=0.15)
