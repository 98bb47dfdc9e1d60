"""One YAML file of OpenCV's ``FileStorage`` per camera."""

from __future__ import annotations

import cv2
import numpy as np

from stcalib_ros.core.model.calibration import CameraCalibration
from stcalib_ros.io.camera_info_yaml import file_names
from stcalib_ros.io.exports.export_format import (
    Exported,
    ExportFormat,
    Files,
    is_fisheye,
    view_of,
)


def _files(exported: Exported, _name: str) -> Files:
    cameras = exported.calibration.cameras
    names = file_names([camera.name for camera in cameras], ".yml")
    return {name: _text(camera) for name, camera in zip(names, cameras, strict=True)}


def _text(camera: CameraCalibration) -> str:
    lens, view = camera.intrinsics, view_of(camera)
    storage = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.writeComment("x_cam = R x_ref + T; t_ref = t_cam + time_offset")
    storage.write("name", camera.name)
    storage.write("image_width", int(lens.width))
    storage.write("image_height", int(lens.height))
    storage.write("fisheye_model", int(is_fisheye(camera)))
    storage.write("camera_matrix", lens.K)
    storage.write("distortion_coefficients", _column(lens.D if lens.D.size else np.zeros(4)))
    storage.write("R", view.R_view_ref)
    storage.write("rvec", cv2.Rodrigues(view.R_view_ref)[0])
    storage.write("T", _column(view.t_view_ref))
    storage.write("covariance", camera.covariance)
    storage.write("time_offset", float(camera.time_offset_s))
    return str(storage.releaseAndGetString())


def _column(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values, dtype=np.float64).reshape(-1, 1)


OPENCV = ExportFormat(
    "opencv", "a YAML file of OpenCV's FileStorage per camera, with R and T", _files
)
