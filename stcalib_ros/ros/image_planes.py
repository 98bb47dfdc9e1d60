"""Where the image of a camera is shown in the scene; knows no ROS."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration

_DEPTH = 0.15
"""Length of a frustum, as a fraction of the largest distance between two cameras."""
_MIN_EXTENT = 1e-3
"""Lengths of the calibration's unit. Smallest size of a rig, for cameras at one place."""
_GAP = 0.25
"""Widths of an image. Gap between images that are shown side by side, which leaves room for what
is written below them. Chosen by looking at it."""
_ROW = 4
"""Images, count, side by side; with more there is another row below. Chosen by looking at it."""
_ROW_HEIGHT = 1.6
"""Heights of an image. From one row to the next, with room for the text between. Chosen by looking
at it."""


@dataclass(frozen=True, slots=True, eq=False)
class ImagePlane:
    """A rectangle in space with the image of a camera on it.

    Attributes
    ----------
    origin : (3,) ndarray
        Upper left corner.
    across, down : (3,) ndarray
        From there to the upper right and to the lower left corner.
    size : (float, float)
        Width and height of the image, px.
    """

    origin: Float64Array
    across: Float64Array
    down: Float64Array
    size: tuple[float, float]

    def place(self, pixels: Float64Array) -> Float64Array:
        """Return where pixels (..., 2) are, (..., 3)."""
        x, y = np.moveaxis(np.asarray(pixels, float) / self.size, -1, 0)
        return np.asarray(self.origin + x[..., None] * self.across + y[..., None] * self.down)

    @property
    def corners(self) -> Float64Array:
        """(4, 3) corners in turn, the upper left one first."""
        width, height = self.size
        return self.place(np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]]))

    @property
    def width(self) -> float:
        """Width of the rectangle."""
        return float(np.linalg.norm(self.across))


def frustum_depth(calibration: Calibration) -> float:
    """Return how long the frusta are shown, in the unit of the calibration."""
    centres = np.array([c.t_ref_cam for c in calibration.cameras]).reshape(-1, 3)
    distances = np.linalg.norm(centres[:, None] - centres[None], axis=-1)
    return _DEPTH * float(max(distances.max(initial=0.0), _MIN_EXTENT))


def frustum_plane(camera: CameraCalibration, depth: float) -> ImagePlane:
    """Return the image at a depth in front of its camera, in the reference frame.

    The lens is taken as ideal: images stay rectangles.
    """
    lens = camera.intrinsics
    u = np.array([0.0, lens.width, 0.0])
    v = np.array([0.0, 0.0, lens.height])
    rays = np.linalg.solve(lens.K, np.stack([u, v, np.ones(3)])).T @ lens.R_rect_cam
    origin, right, below = depth * rays @ camera.R_ref_cam.T + camera.t_ref_cam
    return ImagePlane(origin, right - origin, below - origin, (lens.width, lens.height))


def planes_side_by_side(
    sizes: Mapping[str, tuple[float, float]], *, width: float, T_ref_view: Float64Array
) -> dict[str, ImagePlane]:
    """Return the images of cameras whose places are not known, upright, in rows.

    Parameters
    ----------
    sizes : mapping of str to (float, float)
        Width and height, px, by camera.
    width : float
        Of each image in the scene.
    T_ref_view : (4, 4) ndarray
        Pose of the frame, x ahead and z up, in which they stand at x = 0 with the middle of the
        first row at the origin, to be looked at along x.

    Returns
    -------
    dict of str to ImagePlane
        In the reference frame.
    """
    R, t = T_ref_view[:3, :3], T_ref_view[:3, 3]
    tallest = max((h / w for w, h in sizes.values()), default=1.0) * width
    columns = min(_ROW, len(sizes))
    left = 0.5 * width * (columns + _GAP * (columns - 1))
    planes = {}
    for number, (name, (w, h)) in enumerate(sizes.items()):
        row, column = divmod(number, _ROW)
        y, z = left - column * (1.0 + _GAP) * width, -row * _ROW_HEIGHT * tallest
        height = width * h / w
        planes[name] = ImagePlane(
            R @ np.array([0.0, y, z + 0.5 * height]) + t,
            R @ np.array([0.0, -width, 0.0]),
            R @ np.array([0.0, 0.0, -height]),
            (w, h),
        )
    return planes


def planes_of(
    calibration: Calibration | None,
    sizes: Mapping[str, tuple[float, float]],
    T_ref_view: Float64Array,
) -> dict[str, ImagePlane]:
    """Return where the images of all cameras are shown, in the reference frame.

    At their cameras as far as these are calibrated; the others side by side, below the origin of
    the view if there is a calibration.

    Parameters
    ----------
    calibration : Calibration or None
    sizes : mapping of str to (float, float)
        Width and height of the images, px, by camera, of those that have any.
    T_ref_view : (4, 4) ndarray
        Pose of the frame that is looked at.
    """
    if calibration is None:
        return planes_side_by_side(sizes, width=1.0, T_ref_view=T_ref_view)
    depth = frustum_depth(calibration)
    known = {c.name: frustum_plane(c, depth) for c in calibration.cameras}
    others = _without(sizes, known)
    return known | planes_side_by_side(others, width=depth, T_ref_view=T_ref_view)


def _without(
    sizes: Mapping[str, tuple[float, float]], known: Iterable[str]
) -> dict[str, tuple[float, float]]:
    return {name: size for name, size in sizes.items() if name not in set(known)}
