"""Our own result file, files of ``camera_info_manager``, and arrays of NumPy."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.io.camera_info_yaml import camera_info_text, file_names
from stcalib_ros.io.exports.export_format import Exported, ExportFormat, Files, view_of
from stcalib_ros.io.results import result_text


def _result(exported: Exported, name: str) -> Files:
    return {name: result_text(exported.calibration)}


def _camera_info(exported: Exported, _name: str) -> Files:
    cameras = exported.calibration.cameras
    names = file_names([camera.name for camera in cameras], ".yaml")
    return {name: camera_info_text(camera) for name, camera in zip(names, cameras, strict=True)}


def _npz(exported: Exported, name: str) -> Files:
    stream = io.BytesIO()
    np.savez(stream, **_camera_arrays(exported.calibration))
    return {name: stream.getvalue()}


def _camera_arrays(calibration: Calibration) -> dict[str, Any]:
    """Return arrays of all cameras, named as those of multi-view files."""
    cameras = calibration.cameras
    views, lenses = [view_of(camera) for camera in cameras], [c.intrinsics for c in cameras]
    most = max(lens.D.size for lens in lenses)
    return {
        "camera_names": np.array([camera.name for camera in cameras]),
        "frame_ids": np.array([camera.frame_id for camera in cameras]),
        "image_size": np.array([(lens.width, lens.height) for lens in lenses]),
        "K": np.array([lens.K for lens in lenses]),
        "dist": np.array([np.pad(lens.D, (0, most - lens.D.size)) for lens in lenses]),
        "dist_model": np.array([lens.model.value for lens in lenses]),
        "R": np.array([view.R_view_ref for view in views]),
        "t": np.array([view.t_view_ref for view in views]),
        "covariance": np.array([camera.covariance for camera in cameras]),
        "time_offset_s": np.array([camera.time_offset_s for camera in cameras]),
        "time_offset_stddev_s": np.array([camera.time_offset_stddev_s for camera in cameras]),
        "clock_skew": np.array([camera.clock_skew for camera in cameras]),
        "line_time_s": np.array([camera.line_time_s for camera in cameras]),
        "epoch_s": np.array(calibration.epoch_s),
        "reference": np.array(calibration.reference),
        "frame_id": np.array(calibration.reference_frame),
        "metric": np.array(calibration.metric),
    }


STCALIB = ExportFormat("stcalib", "our own result file", _result, endings=(".yaml",))
CAMERA_INFO = ExportFormat(
    "camera_info", "a lens file NAME.yaml per camera for camera_info_manager", _camera_info
)
NPZ = ExportFormat(
    "npz",
    "arrays of NumPy, x_cam = R x_ref + t",
    _npz,
    endings=(".npz",),
)
