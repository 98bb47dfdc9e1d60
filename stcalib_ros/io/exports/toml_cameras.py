"""TOML files of cameras: aniposelib's, which Pose2Sim and FreeMoCap read, and Caliscope's."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from stcalib_ros.core.geometry.so3 import log_so3
from stcalib_ros.core.model.calibration import CameraCalibration
from stcalib_ros.io.exports.export_format import (
    Exported,
    ExportFormat,
    Files,
    coefficients,
    is_fisheye,
    n_coefficients,
    view_of,
)

_COUNTS = (5, 8, 12, 14)
"""How many coefficients OpenCV, which all of these programs use, takes; 4 are written as 5."""


def _aniposelib(exported: Exported, name: str) -> Files:
    cameras = exported.calibration.cameras
    digits = len(str(len(cameras) - 1))  # aniposelib sorts the sections as text
    tables = {f"cam_{number:0{digits}}": _camera(camera) for number, camera in enumerate(cameras)}
    metadata = {"metadata": {"adjusted": False, "error": 0.0}}
    return {name: "\n".join(map(_table, *zip(*(tables | metadata).items(), strict=True)))}


def _caliscope(exported: Exported, name: str) -> Files:
    cameras = exported.calibration.cameras
    tables = [
        _table(f"cameras.{number}", {"cam_id": number, "rotation_count": 0, **_camera(camera)})
        for number, camera in enumerate(cameras)
    ]
    return {name: "\n".join(tables)}


def _camera(camera: CameraCalibration) -> dict[str, Any]:
    lens, view = camera.intrinsics, view_of(camera)
    count = next(count for count in _COUNTS if n_coefficients(camera) <= count)
    return {
        "name": camera.name,
        "size": [int(lens.width), int(lens.height)],
        "matrix": lens.K.tolist(),
        "distortions": coefficients(camera, count, "aniposelib"),
        "rotation": log_so3(view.R_view_ref).tolist(),
        "translation": view.t_view_ref.tolist(),
        "fisheye": is_fisheye(camera),
    }


def _table(name: str, entries: Mapping[str, Any]) -> str:
    """Text of a table; texts, numbers, lists and truth values are written as JSON has them."""
    lines = [f"{key} = {json.dumps(value, ensure_ascii=False)}\n" for key, value in entries.items()]
    return f"[{name}]\n{''.join(lines)}"


ANIPOSELIB = ExportFormat(
    "aniposelib", "TOML file of aniposelib, Pose2Sim and FreeMoCap", _aniposelib, endings=(".toml",)
)
CALISCOPE = ExportFormat(
    "caliscope", "camera_array.toml of Caliscope", _caliscope, endings=(".toml",)
)
