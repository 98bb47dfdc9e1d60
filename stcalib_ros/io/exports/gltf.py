"""Scenes of glTF 2.0: a camera with its name each, and figures of people.

References
----------
https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html
"""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from stcalib_ros.core.geometry.so3 import quaternion_from_matrix
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration
from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory, bones
from stcalib_ros.io.exports.export_format import Exported, ExportFormat, Files, view_of

_HALF_TURN_ABOUT_X = np.diag([1.0, -1.0, -1.0])
"""Axes of a camera of glTF (y up, it looks along -z) to those of an optical frame."""

_Z_UP_TO_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])

_NEAR = 0.01
"""Lengths of the calibration's unit. Nearer things are not shown; glTF asks for a number."""

_FIGURE_EVERY_S = 0.5
"""Seconds between two figures of one person: dense enough for a path, and still apart."""

_FLOAT, _LINES, _VERTICES = 5126, 1, 34962
"""Numbers by which glTF names float32, line segments and buffers of vertices."""


def _files(exported: Exported, name: str) -> Files:
    calibration = exported.calibration
    figures = [lines for person in exported.people if len(lines := _figures(person))]
    meshes = range(len(figures))
    numbers = range(len(calibration.cameras))
    nodes = [_camera_node(number, calibration.cameras[number]) for number in numbers]
    nodes += [{"name": f"person{number}", "mesh": number} for number in meshes]
    scene = {
        "name": "reference frame",
        "rotation": quaternion_from_matrix(_up(calibration)).tolist(),
        "children": list(range(len(nodes))),
    }
    content: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "stcalib_ros"},
        "scene": 0,
        "scenes": [{"nodes": [len(nodes)]}],
        "nodes": [*nodes, scene],
        "cameras": [_camera(camera) for camera in calibration.cameras],
        **(_meshes(figures) if figures else {}),
    }
    return {name: json.dumps(content, ensure_ascii=False, allow_nan=False, indent=1)}


def _camera(camera: CameraCalibration) -> dict[str, Any]:
    """Return the lens without distortion and as if its axis met the middle of the image."""
    lens = camera.intrinsics
    fx, fy = float(lens.K[0, 0]), float(lens.K[1, 1])
    return {
        "name": camera.name,
        "type": "perspective",
        "perspective": {
            "yfov": 2.0 * float(np.arctan(0.5 * lens.height / fy)),
            "aspectRatio": lens.width * fy / (lens.height * fx),
            "znear": _NEAR,
        },
        "extras": {
            "width": int(lens.width),
            "height": int(lens.height),
            "model": lens.model.value,
            "k": lens.K.ravel().tolist(),
            "d": lens.D.tolist(),
            "time_offset_s": float(camera.time_offset_s),
        },
    }


def _camera_node(number: int, camera: CameraCalibration) -> dict[str, Any]:
    R_ref_view = view_of(camera).R_view_ref.T
    return {
        "name": camera.name,
        "camera": number,
        "rotation": quaternion_from_matrix(R_ref_view @ _HALF_TURN_ABOUT_X).tolist(),
        "translation": camera.t_ref_cam.tolist(),
    }


def _up(calibration: Calibration) -> Float64Array:
    """Rotation of the reference frame to glTF's, which has y up."""
    return _Z_UP_TO_Y_UP if calibration.frame_id else _HALF_TURN_ABOUT_X


def _figures(person: PersonTrajectory) -> Float64Array:
    """Return the ends (n, 2, 3) of the bones of a person at regular times."""
    step_s = float(np.diff(person.times_s[:2]).sum()) or _FIGURE_EVERY_S
    joints = person.joints_ref[:: max(round(_FIGURE_EVERY_S / step_s), 1)]
    pairs = np.array(bones(person.layout), dtype=int).reshape(-1, 2)
    lines = joints[:, pairs].reshape(-1, 2, 3)
    return np.asarray(lines[np.isfinite(lines).all((1, 2))])


def _meshes(figures: Sequence[Float64Array]) -> dict[str, Any]:
    points = [lines.reshape(-1, 3).astype("<f4") for lines in figures]
    data = b"".join(one.tobytes() for one in points)
    begins = np.cumsum([0, *(one.nbytes for one in points)])
    return {
        "meshes": [
            {"primitives": [{"attributes": {"POSITION": number}, "mode": _LINES}]}
            for number in range(len(points))
        ],
        "accessors": [
            {
                "bufferView": number,
                "componentType": _FLOAT,
                "count": len(one),
                "type": "VEC3",
                "min": one.min(0).tolist(),
                "max": one.max(0).tolist(),
            }
            for number, one in enumerate(points)
        ],
        "bufferViews": [
            {
                "buffer": 0,
                "byteOffset": int(begin),
                "byteLength": one.nbytes,
                "target": _VERTICES,
            }
            for begin, one in zip(begins[:-1], points, strict=True)
        ],
        "buffers": [
            {
                "byteLength": len(data),
                "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode(),
            }
        ],
    }


GLTF = ExportFormat(
    "gltf",
    "scene of glTF 2.0 for viewers: cameras with their names, people as figures",
    _files,
    endings=(".gltf",),
    takes_people=True,
)
