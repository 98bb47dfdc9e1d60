"""Images without distortion: straight lines, people in their places, wide lenses."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

import stcalib_ros as st
from stcalib_ros.core.capture.reprojection import ImageOfPeople
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.lens import bearings, project
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.report.style import BACKGROUND
from stcalib_ros.report.undistort import Undistortion, undistortion_of

CAMERA = st.simulate(st.SceneOptions(n_cameras=2, n_people=1, n_frames=2)).truth.cameras[0]
WIDTH, HEIGHT = 640, 480
SHIFT = 4
"""Bits behind the point of coordinates that are drawn: a 16th of a pixel."""


def lens_of(
    focal: float, D: list[float], model: LensModel = LensModel.PLUMB_BOB, *, turn_rad: float = 0.0
) -> Intrinsics:
    K = np.array([[focal, 0.0, 311.5], [0.0, 1.01 * focal, 245.5], [0.0, 0.0, 1.0]])
    R_rect_cam = exp_so3(np.array([0.0, turn_rad, 0.0]))
    return Intrinsics(WIDTH, HEIGHT, model, K, np.array(D), R_rect_cam)


def fisheye(field_of_view_deg: float) -> Intrinsics:
    focal = WIDTH / np.radians(field_of_view_deg)
    return lens_of(focal, [0.01, 0.0, 0.0, 0.0], LensModel.EQUIDISTANT)


LENSES = {
    "barrel": lens_of(480.0, [-0.2, 0.03, 0.0, 0.0, 0.0]),
    "pincushion": lens_of(480.0, [0.15, 0.0, 0.0, 0.0, 0.0]),
    "tangential": lens_of(480.0, [-0.2, 0.03, 0.004, -0.003, 0.0]),
    "rational": lens_of(
        480.0, [0.1, 0.02, 0.0, 0.0, 0.0, 0.35, 0.0, 0.0], LensModel.RATIONAL_POLYNOMIAL
    ),
    "rectified": lens_of(480.0, [-0.1, 0.0, 0.0, 0.0, 0.0], turn_rad=0.1),
    "fisheye 100": fisheye(100.0),
    "fisheye 125": fisheye(125.0),
    "fisheye 180": fisheye(180.0),
}


def undistorted(lens: Intrinsics) -> Undistortion:
    return undistortion_of(replace(CAMERA, intrinsics=lens))


def drawn(lens: Intrinsics, points: np.ndarray) -> np.ndarray:
    """Image (480, 640, 3) of points (N, 3) of the optical frame, connected by lines."""
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    pixels = np.round(project(points, lens) * 2**SHIFT).astype(np.int32)
    cv2.polylines(image, [pixels], False, (255, 255, 255), 2, cv2.LINE_AA, SHIFT)
    return image


def brightness(image: np.ndarray) -> np.ndarray:
    """Of what was drawn (H, W); 0 of what is around it."""
    return np.maximum(image[..., 0].astype(float) - max(BACKGROUND), 0.0)


def bend_px(image: np.ndarray) -> float:
    """How far the middle of a line that goes across an image is from a straight one, px."""
    weight = brightness(image)
    columns = np.flatnonzero(weight.sum(0) > 255.0)[3:-3]
    heights = (weight * np.arange(image.shape[0])[:, None]).sum(0)[columns]
    y = heights / weight.sum(0)[columns]
    assert len(y) > 0.5 * image.shape[1]
    return float(np.abs(y - np.polyval(np.polyfit(columns, y, 1), columns)).max())


@pytest.mark.parametrize("name", LENSES)
def test_what_is_straight_becomes_straight(name: str) -> None:
    lens = LENSES[name]
    across = np.linspace(-2.0, 2.0, 4001)
    line = np.stack([across, 0.3 + 0.05 * across, np.ones_like(across)], -1)
    image = drawn(lens, line)
    assert bend_px(image) > 1.5
    assert bend_px(undistorted(lens).image(image)) < 0.5


@pytest.mark.parametrize("name", LENSES)
def test_points_are_where_the_image_shows_them(name: str) -> None:
    lens, found = LENSES[name], undistorted(LENSES[name])
    for place in ([0.0, 0.0], [0.3, -0.2], [-0.4, 0.25]):
        pixel = project(np.array([*place, 1.0]), lens)
        image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        center = np.round(pixel * 2**SHIFT).astype(int).tolist()
        cv2.circle(image, center, 5 << SHIFT, (255, 255, 255), -1, cv2.LINE_AA, SHIFT)
        weight = brightness(found.image(image))
        rows, columns = np.indices(weight.shape)
        shown = np.array([(weight * one).sum() for one in (columns, rows)]) / weight.sum()
        assert found.points(pixel) == pytest.approx(shown, abs=0.4)


def test_the_middle_row_and_column_stay_whole_and_corners_show_something() -> None:
    lens = LENSES["barrel"]
    found = undistorted(lens)
    ends = found.points(np.array([[0.0, 239.5], [WIDTH - 1.0, 239.5]]))
    assert ends[:, 0] == pytest.approx([0.0, WIDTH - 1.0])
    ends = found.points(np.array([[319.5, 0.0], [319.5, HEIGHT - 1.0]]))
    assert ends[:, 1] == pytest.approx([0.0, found.view.height - 1.0], abs=0.6)
    white = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    assert (found.image(white) > 250).mean() > 0.995


@pytest.mark.parametrize("name", ["fisheye 125", "fisheye 180"])
def test_wide_lenses_show_110_degrees_and_no_black(name: str) -> None:
    found = undistorted(LENSES[name])
    assert (found.image(np.full((HEIGHT, WIDTH, 3), 255, np.uint8)) > 250).mean() > 0.998
    edges = np.array([[0.0, found.view.K[1, 2]], [WIDTH - 1.0, found.view.K[1, 2]]])
    x, _ = bearings(edges, found.view)
    assert np.degrees(np.arctan(x[:, 0])) == pytest.approx([-55.0, 55.0], abs=0.5)


def test_a_lens_without_distortion_keeps_its_images() -> None:
    lens = Intrinsics(
        WIDTH, HEIGHT, LensModel.PLUMB_BOB, np.diag([500.0, 500.0, 1.0]) + 0.0, np.zeros(0)
    )
    lens.K[:2, 2] = 310.0, 250.0
    image = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    found = undistorted(lens)
    assert np.abs(found.view.K - lens.K).max() < 1e-6
    assert np.array_equal(found.image(image), image)


def test_what_a_lens_cannot_image_is_not_shown_twice() -> None:
    # r (1 - .4 r^2) is largest at r = .913: the same places come again beyond.
    lens = lens_of(420.0, [-0.4, 0.0, 0.0, 0.0, 0.0])
    found = undistorted(lens)
    u, v = np.meshgrid(np.arange(found.view.width), np.arange(found.view.height))
    r = np.hypot(*((np.stack([u, v]) - found.view.K[:2, 2, None, None]) / found.view.K[0, 0]))
    assert r.max() > 0.913
    assert (found.column[r > 0.913] == -1.0).all()
    assert (found.column[r < 0.89] != -1.0).all()


def test_a_part_of_a_fisheyes_image_far_from_its_axis_is_refused() -> None:
    lens = fisheye(180.0)
    lens.K[0, 2] = -500.0
    with pytest.raises(InputError, match="cam0 sees next to nothing within 55 degrees"):
        undistorted(lens)


def test_people_out_of_the_view_are_left_out() -> None:
    lens = LENSES["fisheye 180"]
    inside = project(np.array([[0.2, 0.1, 1.0], [6.0, 0.0, 1.0]]), lens)
    outside = project(np.array([[6.0, 0.1, 1.0], [6.0, 0.0, 1.0]]), lens)
    nothing = np.full((2, 2), np.nan)
    people = {0: inside, 1: outside, 2: nothing}
    one = ImageOfPeople(CAMERA, 0.0, 1.0, people, inside[None], 1.0, 2)
    moved = undistorted(lens).people(one)
    assert list(moved.projected) == [0]
    assert moved.found == pytest.approx(moved.projected[0][None], nan_ok=True)
    assert moved.residual_px == one.residual_px
