"""Text models of COLMAP: ``cameras.txt``, ``images.txt``, ``points3D.txt``.

References
----------
https://colmap.github.io/format.html
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.so3 import quaternion_from_matrix
from stcalib_ros.core.model.calibration import CameraCalibration
from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory
from stcalib_ros.io.exports.export_format import (
    FISHEYE_COEFFICIENTS,
    Exported,
    ExportFormat,
    Files,
    coefficients,
    is_fisheye,
    n_coefficients,
    pinhole,
    view_of,
)

_PIXEL_CENTRE = 0.5
"""Pixels. COLMAP's image coordinates have the corner of the first pixel at 0, ours its centre."""

_OPENCV_COEFFICIENTS = 4
"""Of COLMAP's ``OPENCV``: k1, k2, p1, p2."""

_FULL_OPENCV_COEFFICIENTS = 8
"""Of COLMAP's ``FULL_OPENCV``: k1, k2, p1, p2, k3, k4, k5, k6."""

_COLORS = ((230, 25, 75), (60, 180, 75), (0, 130, 200), (245, 130, 48), (145, 30, 180))
"""Red, green and blue of the points of one person after the other; bright ones that differ."""


def _files(exported: Exported, _name: str) -> Files:
    cameras = exported.calibration.cameras
    return {
        "cameras.txt": "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
        + "".join(_camera_line(number, camera) for number, camera in enumerate(cameras, 1)),
        "images.txt": "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; POINTS2D[]\n"
        + "".join(_image_lines(number, camera) for number, camera in enumerate(cameras, 1)),
        "points3D.txt": "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]: joints of people\n"
        + "".join(_point_lines(exported.people)),
    }


def _camera_line(number: int, camera: CameraCalibration) -> str:
    model, distortion = _distortion(camera)
    fx, fy, cx, cy = pinhole(camera)
    parameters = [fx, fy, cx + _PIXEL_CENTRE, cy + _PIXEL_CENTRE, *distortion]
    lens = camera.intrinsics
    return f"{number} {model} {lens.width} {lens.height} {_numbers(parameters)}\n"


def _distortion(camera: CameraCalibration) -> tuple[str, list[float]]:
    """Return the model with the fewest coefficients that has those of a lens, and these."""
    if is_fisheye(camera):
        return "OPENCV_FISHEYE", coefficients(camera, FISHEYE_COEFFICIENTS, "colmap")
    needed = n_coefficients(camera)
    if needed == 0:
        return "PINHOLE", []
    if needed <= _OPENCV_COEFFICIENTS:
        return "OPENCV", coefficients(camera, _OPENCV_COEFFICIENTS, "colmap")
    return "FULL_OPENCV", coefficients(camera, _FULL_OPENCV_COEFFICIENTS, "colmap")


def _image_lines(number: int, camera: CameraCalibration) -> str:
    if " " in camera.name:
        raise InputError(
            f"camera {camera.name!r}: names of COLMAP have no spaces; rename it in the result file"
        )
    view = view_of(camera)
    x, y, z, w = quaternion_from_matrix(view.R_view_ref)
    pose = _numbers([w, x, y, z, *view.t_view_ref])
    return f"{number} {pose} {number} {camera.name}.png\n\n"


def _point_lines(people: Sequence[PersonTrajectory]) -> list[str]:
    lines: list[str] = []
    for number, person in enumerate(people):
        r, g, b = _COLORS[number % len(_COLORS)]
        joints = person.joints_ref.reshape(-1, 3)
        for point in joints[np.isfinite(joints).all(1)]:
            lines.append(f"{len(lines) + 1} {_numbers(point.tolist())} {r} {g} {b} -1\n")
    return lines


def _numbers(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


COLMAP = ExportFormat(
    "colmap",
    "text model of COLMAP, with people as points",
    _files,
    takes_people=True,
)
