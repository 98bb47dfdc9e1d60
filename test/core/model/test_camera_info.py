"""A lens from CameraInfo: what a camera publishes is where OpenCV puts it on the sensor."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.camera_info import intrinsics_from_camera_info
from stcalib_ros.core.model.recording import LensModel

K = [900.0, 0.0, 655.0, 0.0, 880.0, 340.0, 0.0, 0.0, 1.0]
P = [850.0, 0.0, 640.0, -120.0, 0.0, 850.0, 360.0, 0.0, 0.0, 0.0, 1.0, 0.0]
LENSES = {
    "plumb_bob": [-0.21, 0.06, 0.001, -0.002, 0.01],
    "rational_polynomial": [0.3, -0.1, 0.001, -0.002, 0.02, 0.5, -0.05, 0.01],
    "equidistant": [-0.02, 0.01, -0.003, 0.001],
}


def camera_info(**changes: Any) -> dict[str, Any]:
    return {
        "width": 1280,
        "height": 720,
        "distortion_model": "plumb_bob",
        "d": LENSES["plumb_bob"],
        "k": K,
        "r": np.eye(3).ravel(),
        "p": P,
        "rectified": False,
    } | changes


def project(model: LensModel, points: np.ndarray, k: np.ndarray, d: np.ndarray) -> np.ndarray:
    if model is LensModel.EQUIDISTANT:
        zero = np.zeros((3, 1))
        pixels, _ = cv2.fisheye.projectPoints(points[:, None], zero, zero, k, d)
    else:
        pixels, _ = cv2.projectPoints(points[:, None], np.zeros(3), np.zeros(3), k, d)
    return pixels[:, 0]


@pytest.fixture
def points(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform([-1, -1, 3], [1, 1, 8], (50, 3))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("binning", [(0, 0), (1, 1), (2, 4)])
@pytest.mark.parametrize("roi", [(0, 0, 0, 0), (100, 40, 640, 480)])
def test_projecting_then_cutting_and_binning_equals_the_adjusted_lens(name, binning, roi, points):
    full = project(LensModel(name), points, np.reshape(K, (3, 3)), np.array(LENSES[name]))
    expected = (full - roi[:2]) / np.maximum(binning, 1)
    lens = intrinsics_from_camera_info(
        **camera_info(
            distortion_model=name,
            d=LENSES[name],
            binning_x=binning[0],
            binning_y=binning[1],
            roi=roi,
        )
    )
    np.testing.assert_allclose(
        project(lens.model, points, lens.K, lens.D), expected, rtol=0, atol=1e-9
    )
    assert lens.model is LensModel(name)
    size = roi[2:] if roi[2] else (1280, 720)
    assert (lens.width, lens.height) == tuple(np.floor_divide(size, np.maximum(binning, 1)))
    np.testing.assert_array_equal(lens.R_rect_cam, np.eye(3))


def test_rectified_takes_the_pinhole_of_p_the_rotation_of_r_and_no_distortion(points):
    R_rect_cam, _ = cv2.Rodrigues(np.array([0.02, -0.03, 0.01]))
    lens = intrinsics_from_camera_info(
        **camera_info(
            r=R_rect_cam.ravel(),
            rectified=True,
            binning_x=2,
            binning_y=2,
            roi=(80, 60, 600, 400),
        )
    )
    in_rect = points @ R_rect_cam.T
    on_sensor = in_rect[:, :2] / in_rect[:, 2:] * 850.0 + [640.0, 360.0]
    homogeneous = points @ lens.R_rect_cam.T @ lens.K.T
    np.testing.assert_allclose(
        homogeneous[:, :2] / homogeneous[:, 2:], (on_sensor - [80, 60]) / 2, atol=1e-9
    )
    assert lens.D.size == 0
    assert (lens.width, lens.height) == (300, 200)


def test_rectified_key_points_need_no_lens_model():
    lens = intrinsics_from_camera_info(
        **camera_info(distortion_model="omnidirectional", d=[1.0], rectified=True)
    )
    assert lens.D.size == 0


@pytest.mark.parametrize(
    "changes",
    [
        {"k": [0.0] * 9},
        {"k": [0.0] * 8 + [1.0], "d": [0.1], "distortion_model": "kannala"},
        {"k": [0.0] * 9, "d": [], "distortion_model": ""},
        {"p": [0.0] * 12, "r": [0.0] * 9, "rectified": True},
    ],
)
def test_a_zero_matrix_is_a_lens_that_is_not_known(changes):
    region = {"binning_x": 2, "binning_y": 2, "roi": (40, 20, 800, 600)}
    lens = intrinsics_from_camera_info(**camera_info(**changes, **region))
    assert (lens.known, lens.width, lens.height) == (False, 400, 300)
    assert lens.sensor == (-20.0, -10.0, 640.0, 360.0)
    assert lens.D.size == 0
    np.testing.assert_array_equal(lens.R_rect_cam, np.eye(3))


def test_the_rotation_of_a_rectified_image_is_kept_without_a_lens():
    R = [0.8, 0.0, 0.6, 0.0, 1.0, 0.0, -0.6, 0.0, 0.8]
    lens = intrinsics_from_camera_info(**camera_info(p=[0.0] * 12, r=R, rectified=True))
    assert not lens.known
    np.testing.assert_array_equal(lens.R_rect_cam.ravel(), R)


@pytest.mark.parametrize("d", [[], [0.0] * 5])
def test_an_empty_model_without_distortion_is_a_pinhole(d):
    lens = intrinsics_from_camera_info(**camera_info(distortion_model="", d=d))
    assert lens.model is LensModel.PLUMB_BOB
    assert not lens.D.any()


def test_the_record_does_not_share_memory_with_the_message():
    k, d = np.array(K), np.array(LENSES["plumb_bob"])
    lens = intrinsics_from_camera_info(**camera_info(k=k, d=d))
    k[:], d[:] = 0, 0
    np.testing.assert_array_equal(lens.K.ravel(), K)
    np.testing.assert_array_equal(lens.D, LENSES["plumb_bob"])


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"k": [1.0] * 8}, "K: expected 9 numbers, got 8"),
        ({"k": [*K[:8], 2.0]}, "K is not a pinhole matrix"),
        ({"k": [-900.0, *K[1:]]}, "K is not a pinhole matrix"),
        ({"k": [float("nan"), *K[1:]]}, "K is not finite"),
        ({"d": [float("inf")] * 5}, "D is not finite"),
        ({"d": [0.1] * 3}, "D has 3 coefficients: plumb_bob takes 0, 4, 5"),
        (
            {"distortion_model": "equidistant", "d": [0.1] * 5},
            "D has 5 coefficients: equidistant takes 0, 4",
        ),
        ({"distortion_model": "kannala"}, "'kannala': use one of plumb_bob, rational_polynomial"),
        ({"distortion_model": ""}, "unknown CameraInfo.distortion_model ''"),
        ({"width": 0}, "image of 0 x 720 px"),
        ({"roi": (1000, 0, 500, 100)}, r"\(1000, 0, 500, 100\) is not within .* 1280 x 720 px"),
        ({"r": [0.0] * 9, "rectified": True}, "R is no rotation"),
    ],
)
def test_what_cannot_be_used_is_said(changes, says):
    with pytest.raises(InputError, match=says) as caught:
        intrinsics_from_camera_info(**camera_info(**changes))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("model", "d", "taken", "coefficients"),
    [
        ("plumb_bob", [0.0] * 8, LensModel.PLUMB_BOB, [0.0] * 5),
        ("plumb_bob", [0.1, -0.2, 0.0, 0.0, 0.05, 0.0, 0.0, 0.0], LensModel.PLUMB_BOB, None),
        ("plumb_bob", [0.1, -0.2, 0.0, 0.0, 0.05, 0.0], LensModel.PLUMB_BOB, None),
        ("plumb_bob", [0.1] * 8, LensModel.RATIONAL_POLYNOMIAL, [0.1] * 8),
        ("plumb_bob", [0.1] * 6 + [0.0] * 6, LensModel.RATIONAL_POLYNOMIAL, None),
        ("equidistant", [0.1, 0.0, 0.0, 0.0, 0.0], LensModel.EQUIDISTANT, [0.1, 0.0, 0.0, 0.0]),
        ("rational_polynomial", [0.1, 0.2, 0.0, 0.0, 0.0], LensModel.PLUMB_BOB, None),
    ],
)
def test_zeros_at_the_end_of_d_do_not_matter(
    model: str, d: list[float], taken: LensModel, coefficients: list[float] | None
) -> None:
    """OpenCV goes on from k3 with k4, k5, k6: with zeros there, the lens is the same."""
    lens = intrinsics_from_camera_info(**camera_info(distortion_model=model, d=d))
    assert lens.model is taken
    if coefficients is not None:
        assert lens.D.tolist() == coefficients
    expected = np.zeros(14)
    expected[: len(d)] = d
    np.testing.assert_array_equal(np.pad(lens.D, (0, 14 - len(lens.D))), expected)
