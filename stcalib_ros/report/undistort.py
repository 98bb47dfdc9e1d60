"""Images without the distortion of their lens: straight edges are straight in them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from stcalib_ros.core.capture.reprojection import ImageOfPeople
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.lens import bearings, project_plane
from stcalib_ros.core.geometry.radial import LEAST_SLOPE, radial_profile
from stcalib_ros.core.model.arrays import Float32Array, Float64Array
from stcalib_ros.core.model.calibration import CameraCalibration
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.estimation.poses import UInt8Array
from stcalib_ros.report.style import BACKGROUND

_WIDEST_DEG = 55.0
"""Degrees from the optical axis, to each side. More is not shown of a wide lens: a flat image
stretches what is there to three times of what is in its middle. Chosen."""
_RADII = 1000
"""Count of distances from the axis, at which it is tested whether a lens still images outwards.
Numerical: a thousandth of the image."""
_LEAST_SHARE = 0.1
"""Fraction of an image's width and height that has to be within the widest view: less is a strip
in which nobody can be seen. Chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class Undistortion:
    """What removes the distortion from the images of a camera.

    Attributes
    ----------
    lens : Intrinsics
        Of the images.
    view : Intrinsics
        A pinhole lens, of the images without distortion.
    column, row : (height, width) ndarray
        Where in the image of the lens each pixel of the view comes from, px; -1: nowhere.
    """

    lens: Intrinsics
    view: Intrinsics
    column: Float32Array
    row: Float32Array

    def points(self, pixels: Float64Array) -> Float64Array:
        """Return where points (..., 2) of an image are without distortion, px."""
        x, _ = bearings(pixels, self.lens)
        return project_plane(x, self.view)

    def image(self, image: UInt8Array) -> UInt8Array:
        """Return an image (height, width, 3) without distortion."""
        straight = cv2.remap(
            image,
            self.column,
            self.row,
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=BACKGROUND,
        )
        return np.asarray(straight, np.uint8)

    def people(self, one: ImageOfPeople) -> ImageOfPeople:
        """Return those people of an image who are in the view, where they are in it."""
        moved = {number: self.points(joints) for number, joints in one.projected.items()}
        in_view = {number: joints for number, joints in moved.items() if self._shows(joints)}
        return replace(one, projected=in_view, found=self.points(one.found))

    def _shows(self, joints: Float64Array) -> bool:
        size = np.array([self.view.width, self.view.height])
        return bool(((joints >= 0) & (joints < size)).all(-1).any())


def undistortion_of(camera: CameraCalibration) -> Undistortion:
    """Return what removes the distortion from the images of a camera.

    The middle row and the middle column of the image stay whole, up to 55 degrees from the optical
    axis, and the image as wide as it is.

    Parameters
    ----------
    camera : CameraCalibration

    Raises
    ------
    InputError
        The image is beyond 55 degrees, as a part of a fisheye's may be.
    """
    lens = camera.intrinsics
    view = _view(camera.name, lens)
    D = lens.D if lens.D.size else np.zeros(4)
    both = (lens.K, D, lens.R_rect_cam.T, view.K, (view.width, view.height), cv2.CV_32FC1)
    if lens.model is LensModel.EQUIDISTANT:
        column, row = cv2.fisheye.initUndistortRectifyMap(*both)
    else:
        column, row = cv2.initUndistortRectifyMap(*both)
    u, v = np.arange(view.width), np.arange(view.height)
    x, y = (u - view.K[0, 2]) / view.K[0, 0], (v - view.K[1, 2]) / view.K[1, 1]
    column[np.hypot(x, y[:, None]) > _farthest(lens)] = -1.0
    return Undistortion(lens, view, np.asarray(column, np.float32), np.asarray(row, np.float32))


def _view(name: str, lens: Intrinsics) -> Intrinsics:
    """Return the pinhole lens of the images without distortion."""
    middle_u, middle_v = (lens.width - 1) / 2.0, (lens.height - 1) / 2.0
    u, v = np.arange(lens.width, dtype=float), np.arange(lens.height, dtype=float)
    left, right = _within(bearings(np.stack([u, np.full_like(u, middle_v)], -1), lens)[0][:, 0])
    top, bottom = _within(bearings(np.stack([np.full_like(v, middle_u), v], -1), lens)[0][:, 1])
    if not (left < right and top < bottom):
        raise InputError(
            f"{name} sees next to nothing within {_WIDEST_DEG:.0f} degrees of its optical axis: "
            "draw it without --undistort"
        )
    focal = (lens.width - 1) / (right - left)
    height = 1 + round(focal * (bottom - top))
    K = np.array([[focal, 0.0, -left * focal], [0.0, focal, -top * focal], [0.0, 0.0, 1.0]])
    return Intrinsics(lens.width, height, LensModel.PLUMB_BOB, K, np.zeros(0))


def _within(x: Float64Array) -> tuple[float, float]:
    """Range of the coordinates (N,) on the plane z = 1 that are not too wide; empty of too few."""
    inside = x[np.abs(x) <= np.tan(np.radians(_WIDEST_DEG))]
    if len(inside) < _LEAST_SHARE * len(x):
        return 0.0, 0.0
    return float(inside.min()), float(inside.max())


def _farthest(lens: Intrinsics) -> float:
    """Distance on the plane z = 1, beyond which a lens would image inwards again."""
    r = np.linspace(0.0, 2.0 * np.tan(np.radians(_WIDEST_DEG)), _RADII)
    slope = radial_profile([lens]).at(r[None]).slope[0]
    inwards = np.flatnonzero(slope <= LEAST_SLOPE)
    return float(r[inwards[0]] if len(inwards) else np.inf)
