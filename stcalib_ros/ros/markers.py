"""Cameras as markers: a frustum, a name and an accuracy each."""

from __future__ import annotations

import math

import numpy as np
from builtin_interfaces.msg import Time
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from stcalib_ros.core.bundle.covariance import largest_stddev
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration
from stcalib_ros.ros.image_planes import frustum_depth, frustum_plane
from stcalib_ros.ros.marker_shapes import Color, Pen, duration

_LINE_WIDTH, _TEXT_HEIGHT, _SMALL_TEXT = 0.03, 0.25, 0.12
"""Fractions of the length of a frustum: its lines, the name, and the accuracy below it. Chosen by
looking at it."""
_NAME_ABOVE, _ACCURACY_ABOVE = 0.45, 0.25
"""Fractions of the length of a frustum by which the middle of each text is above the camera, as
its image has it, so that they do not cover each other. Chosen by looking at it."""
_SIGMAS = 3.0
"""Standard deviations. Half axes of the ellipsoid of the position of a camera: it is in there with
a probability of 97 %."""
_LEAST_AXIS = 0.01
"""Fraction of the length of a frustum. A shorter half axis of an ellipsoid is shown this long: RViz
warns of a size of zero, and nobody sees it."""
_CAMERA: Color = (0.1, 0.5, 0.9, 1.0)
"""Red, green, blue and opacity of the cameras, 0 to 1: visible on dark and on light backgrounds."""
_UNCERTAINTY: Color = (0.9, 0.6, 0.1, 0.5)
"""Of the ellipsoids; as `_CAMERA`, and one sees through."""


def camera_markers(calibration: Calibration, *, stamp: Time) -> MarkerArray:
    """Return frusta, names and accuracies, after the deletion of earlier markers.

    Parameters
    ----------
    calibration : Calibration
    stamp : builtin_interfaces.msg.Time

    Returns
    -------
    visualization_msgs.msg.MarkerArray
        In the reference frame, to stay until the next: namespaces ``frusta``, ``names``,
        ``accuracy`` (text) and ``uncertainty`` (ellipsoids of three standard deviations), ids by
        the order of the cameras.
    """
    header = Header(stamp=stamp, frame_id=calibration.reference_frame)
    pen, depth = Pen(header, duration(0.0)), frustum_depth(calibration)
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    for number, camera in enumerate(calibration.cameras):
        markers += _camera(camera, pen, number, depth, metric=calibration.metric)
    return MarkerArray(markers=markers)


def _camera(
    camera: CameraCalibration, pen: Pen, number: int, depth: float, *, metric: bool
) -> list[Marker]:
    corners = frustum_plane(camera, depth).corners
    centre, up = camera.t_ref_cam, -camera.R_ref_cam[:, 1]
    rays = [end for corner in corners for end in (centre, corner)]
    frame = [corners[i] for k in range(4) for i in (k, (k + 1) % 4)]
    name_at, accuracy_at = centre + _NAME_ABOVE * depth * up, centre + _ACCURACY_ABOVE * depth * up
    text = accuracy_text(camera, metric=metric)
    return [
        pen.lines("frusta", number, np.array(rays + frame), _LINE_WIDTH * depth, _CAMERA),
        pen.text("names", number, name_at, _TEXT_HEIGHT * depth, _CAMERA, camera.name),
        pen.text("accuracy", number, accuracy_at, _SMALL_TEXT * depth, _CAMERA, text),
        pen.ellipsoid(
            "uncertainty", number, centre, _half_axes(camera, _LEAST_AXIS * depth), _UNCERTAINTY
        ),
    ]


def accuracy_text(camera: CameraCalibration, *, metric: bool) -> str:
    """Say how well the pose and the clock of a camera are known.

    Standard deviations of the position and of the rotation in their least certain directions, and
    of the time offset, which is given, too; of the reference camera only that it is that.
    """
    place = largest_stddev(camera.covariance[:3, :3])
    turn = largest_stddev(camera.covariance[3:, 3:])
    if place == 0.0 and camera.time_offset_s == 0.0:
        return "reference"
    length = f"{1e3 * place:.1f} mm" if metric else f"{place:.4f} baselines"
    return (
        f"+-{length}, +-{math.degrees(turn):.2f} deg\n"
        f"clock {1e3 * camera.time_offset_s:+.1f} +-{1e3 * camera.time_offset_stddev_s:.1f} ms"
    )


def _half_axes(camera: CameraCalibration, least: float) -> Float64Array:
    """Half axes (3, 3), in columns, of the ellipsoid of `_SIGMAS` of the position."""
    covariance = 0.5 * (camera.covariance + camera.covariance.T)[:3, :3]
    variances, axes = np.linalg.eigh(covariance)
    return np.asarray(axes * np.maximum(_SIGMAS * np.sqrt(np.maximum(variances, 0.0)), least))
