"""Cameras as markers for RViz: a frustum and a name each."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration

_DEPTH = 0.15
"""Length of a frustum, as a fraction of the largest distance between two cameras."""
_MIN_EXTENT = 1e-3
"""Lengths of the calibration's unit. Smallest size of a rig, for cameras at one place."""
_LINE_WIDTH, _TEXT_HEIGHT = 0.03, 0.4
"""Fractions of the length of a frustum."""

_COLOR = ColorRGBA(r=0.1, g=0.5, b=0.9, a=1.0)
"""Red, green, blue and opacity of the cameras, 0 to 1: visible on dark and on light backgrounds."""


def camera_markers(calibration: Calibration, *, stamp: Time) -> MarkerArray:
    """Return frusta and names in the reference frame, after the deletion of earlier markers."""
    header = Header(stamp=stamp, frame_id=calibration.reference_frame)
    depth = _DEPTH * _extent(calibration)
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    for number, camera in enumerate(calibration.cameras):
        markers += [
            _frustum(camera, header, number, depth),
            _name(camera, header, number, depth),
        ]
    return MarkerArray(markers=markers)


def _extent(calibration: Calibration) -> float:
    centres = np.array([c.t_ref_cam for c in calibration.cameras]).reshape(-1, 3)
    distances = np.linalg.norm(centres[:, None] - centres[None], axis=-1)
    return float(max(distances.max(initial=0.0), _MIN_EXTENT))


def _frustum(camera: CameraCalibration, header: Header, number: int, depth: float) -> Marker:
    corners = _corners(camera, depth)
    apex = camera.t_ref_cam
    rays = [point for corner in corners for point in (apex, corner)]
    frame = [corners[i] for k in range(4) for i in (k, (k + 1) % 4)]
    return Marker(
        header=header,
        ns="frusta",
        id=number,
        type=Marker.LINE_LIST,
        pose=Pose(orientation=Quaternion(w=1.0)),
        scale=Vector3(x=_LINE_WIDTH * depth),
        color=_COLOR,
        lifetime=Duration(),
        points=[_point(p) for p in rays + frame],
    )


def _corners(camera: CameraCalibration, depth: float) -> Float64Array:
    """(4, 3) corners of the image at a depth, in the reference frame; the lens taken as ideal."""
    lens = camera.intrinsics
    u = np.array([0.0, lens.width, lens.width, 0.0])
    v = np.array([0.0, 0.0, lens.height, lens.height])
    rays = np.linalg.solve(lens.K, np.stack([u, v, np.ones(4)])).T @ lens.R_rect_cam
    return np.asarray(depth * rays @ camera.R_ref_cam.T + camera.t_ref_cam)


def _name(camera: CameraCalibration, header: Header, number: int, depth: float) -> Marker:
    return Marker(
        header=header,
        ns="names",
        id=number,
        type=Marker.TEXT_VIEW_FACING,
        pose=Pose(position=_point(camera.t_ref_cam), orientation=Quaternion(w=1.0)),
        scale=Vector3(z=_TEXT_HEIGHT * depth),
        color=_COLOR,
        text=camera.name,
    )


def _point(p: Float64Array) -> Point:
    return Point(x=float(p[0]), y=float(p[1]), z=float(p[2]))
