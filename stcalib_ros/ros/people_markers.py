"""People as markers: in 3D, and in the image of every camera."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from visualization_msgs.msg import Marker

from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.ros.image_planes import ImagePlane
from stcalib_ros.ros.marker_shapes import Color, Pen
from stcalib_ros.ros.recognition import SeenImage
from stcalib_ros.ros.sightings import SeenPerson, Sighting

_PALETTE: tuple[Color, ...] = (
    (0.90, 0.33, 0.05, 1.0),
    (0.16, 0.63, 0.86, 1.0),
    (0.98, 0.80, 0.10, 1.0),
    (0.75, 0.35, 0.85, 1.0),
    (0.10, 0.75, 0.55, 1.0),
    (0.95, 0.45, 0.65, 1.0),
    (0.55, 0.70, 0.20, 1.0),
    (0.45, 0.45, 0.95, 1.0),
)
"""Red, green, blue and opacity, 0 to 1, of people, in turn. Told apart on dark and light
backgrounds."""
_JOINT, _LIMB, _TEXT, _ABOVE = 0.035, 0.018, 0.09, 0.62
"""Fractions of the extent of a body: balls of joints, width of limbs, height of text, and how far
it is above the middle of the body. Chosen by looking at them."""
_DOT, _LINE = 0.012, 0.006
"""Fractions of the width of an image: dots of keypoints and lines of people in it. Chosen by
looking at them."""
_RED_AT = 3.0
"""Multiple of the usual error. From here on keypoints are red: as outliers are told by the
adjustment (`bundle.outlier_factor`)."""
_USUAL_PX = 2.0
"""Pixels. Smallest usual error, for results without noise, where all would be red otherwise."""


def color_of(number: int) -> Color:
    """Return the color of a person, everywhere the same."""
    return _PALETTE[number % len(_PALETTE)]


def heat(ratio: float) -> Color:
    """Return a color from green, at 0, by yellow to red, at 1 and above.

    Examples
    --------
    >>> heat(0.0)[:3], heat(0.5)[:3], heat(2.0)[:3]
    ((0.0, 1.0, 0.0), (1.0, 1.0, 0.0), (1.0, 0.0, 0.0))
    """
    ratio = min(max(ratio, 0.0), 1.0)
    return min(2.0 * ratio, 1.0), min(2.0 - 2.0 * ratio, 1.0), 0.0, 1.0


def people_markers(
    sight: Sighting,
    time_s: float,
    calibration: Calibration,
    planes: Mapping[str, ImagePlane],
    *,
    up: Float64Array,
    pen: Pen,
) -> list[Marker]:
    """Return everybody at one time.

    Parameters
    ----------
    sight : Sighting
    time_s : float
        Seconds since the Unix epoch, reference clock.
    calibration : Calibration
    planes : mapping of str to ImagePlane
        By camera.
    up : (3,) ndarray
        Against gravity, in the reference frame.
    pen : Pen

    Returns
    -------
    list of visualization_msgs.msg.Marker
        Namespaces ``joints``, ``limbs``, ``people`` (text), ``paths`` and ``in CAMERA``, ids by
        the numbers of people; and ``residuals``, ids by the order of the cameras: the keypoints in
        the images, green where they agree with the people in 3D.
    """
    there = [(person, person.shown_at(time_s)) for person in sight.people]
    markers = [m for p, joints in there for m in _person(p, joints, time_s, up, pen)]
    usual = max(calibration.reprojection_rms_px, _USUAL_PX)
    for number, camera in enumerate(calibration.cameras):
        plane = planes[camera.name]
        markers += [m for p, joints in there for m in _in_image(p, joints, camera, plane, pen)]
        images = sight.images.get(camera.name, ())
        nearest = min(images, key=lambda image: abs(image.time_s - time_s), default=None)
        if nearest is not None and len(nearest.pixels):
            markers.append(_residuals(nearest, number, plane, usual, pen))
    return markers


def _person(
    person: SeenPerson, joints: Float64Array, time_s: float, up: Float64Array, pen: Pen
) -> list[Marker]:
    known = joints[np.isfinite(joints).all(-1)]
    if not len(known):
        return []
    number, size, color = person.number, person.size, color_of(person.number)
    label = known.mean(0) + _ABOVE * size * up
    markers = [
        pen.points("joints", number, known, _JOINT * size, [color]),
        pen.text("people", number, label, _TEXT * size, color, f"person {number}"),
    ]
    path = _path(person, time_s)
    for ns, ends in (("limbs", limbs(person.layout, joints)), ("paths", path)):
        if len(ends):
            markers.append(pen.lines(ns, number, ends, _LIMB * size, color))
    return markers


def limbs(layout: Layout, joints: Float64Array) -> Float64Array:
    """Return both ends, in turn, of the limbs (2 N, D) whose joints (J, D) are known."""
    pairs = [(i, parent) for i, parent in enumerate(layout.parents) if parent >= 0]
    ends = joints[np.array(pairs, dtype=np.int64).reshape(-1, 2)]
    return np.asarray(ends[np.isfinite(ends).all((1, 2))].reshape(-1, joints.shape[-1]))


def _path(person: SeenPerson, time_s: float) -> Float64Array:
    """Return both ends, in turn, of the pieces of the path of the middle of the body so far."""
    past = person.joints_ref[person.times_s <= time_s]
    known = np.isfinite(past).all(-1, keepdims=True)
    n = known.sum(1)
    most = n[:, 0] > 0.5 * past.shape[1]  # of a part of the body the middle is elsewhere
    middle = np.where(known, past, 0.0).sum(1)[most] / n[most]
    return np.repeat(middle, 2, axis=0)[1:-1]


def _in_image(
    person: SeenPerson, joints: Float64Array, camera: CameraCalibration, plane: ImagePlane, pen: Pen
) -> list[Marker]:
    """Return the limbs of a person in an image, as far as they are within it."""
    pixels = project((joints - camera.t_ref_cam) @ camera.R_ref_cam, camera.intrinsics)
    with np.errstate(invalid="ignore"):
        outside = ((pixels < 0.0) | (pixels > plane.size)).any(-1)
    pixels[outside] = np.nan
    ends = limbs(person.layout, pixels)
    if not len(ends):
        return []
    name, color = f"in {camera.name}", color_of(person.number)
    return [pen.lines(name, person.number, plane.place(ends), _LINE * plane.width, color)]


def _residuals(
    image: SeenImage, number: int, plane: ImagePlane, usual_px: float, pen: Pen
) -> Marker:
    colors = [heat(error / (_RED_AT * usual_px)) for error in image.errors_px]
    return pen.points("residuals", number, plane.place(image.pixels), _DOT * plane.width, colors)
