"""Camera chains of Kalibr, ``camchain-imucam.yaml``.

References
----------
https://github.com/ethz-asl/kalibr/wiki/yaml-formats
"""

from __future__ import annotations

from typing import Any

import numpy as np
import yaml

from stcalib_ros.core.model.calibration import Calibration, CameraCalibration
from stcalib_ros.io.exports.export_format import (
    Exported,
    ExportFormat,
    Files,
    coefficients,
    is_fisheye,
    pinhole,
    view_of,
)

_RADTAN_COEFFICIENTS = 4
"""Of Kalibr's ``radtan``: k1, k2, p1, p2."""

_HEAD = """\
# Kalibr knows cameras by number; rostopic has their names.
# The reference frame and clock ({frame}) stand where Kalibr has those of an IMU:
#   T_cam_imu: x_cam = T x_ref     timeshift_cam_imu: t_ref = t_cam + shift
# T_cn_cnm1 takes points of the camera before to this one.
"""
_SKEW = """\
# Clock skews, which Kalibr has no place for: the shifts hold at {epoch_s!r} s.
"""


def _files(exported: Exported, name: str) -> Files:
    calibration = exported.calibration
    chain = {
        f"cam{number}": _camera(calibration, number) for number in range(len(calibration.cameras))
    }
    text = _HEAD.format(frame=calibration.reference_frame)
    if any(camera.clock_skew for camera in calibration.cameras):
        text += _SKEW.format(epoch_s=float(calibration.epoch_s))
    body = yaml.safe_dump(chain, sort_keys=False, default_flow_style=None, allow_unicode=True)
    return {name: text + body}


def _camera(calibration: Calibration, number: int) -> dict[str, Any]:
    camera = calibration.cameras[number]
    T_cam_ref = view_of(camera).T_view_ref
    entries: dict[str, Any] = {
        "camera_model": "pinhole",
        "intrinsics": pinhole(camera),
        "distortion_model": "equidistant" if is_fisheye(camera) else "radtan",
        "distortion_coeffs": coefficients(camera, _RADTAN_COEFFICIENTS, "kalibr"),
        "resolution": [int(camera.intrinsics.width), int(camera.intrinsics.height)],
        "rostopic": f"/{camera.name}/image_raw",
        "cam_overlaps": _overlaps(calibration, camera),
        "timeshift_cam_imu": float(camera.time_offset_s),
        "T_cam_imu": T_cam_ref.tolist(),
    }
    if number > 0:
        T_before_ref = view_of(calibration.cameras[number - 1]).T_view_ref
        entries["T_cn_cnm1"] = (T_cam_ref @ np.linalg.inv(T_before_ref)).tolist()
    return entries


def _overlaps(calibration: Calibration, camera: CameraCalibration) -> list[int]:
    """Return the numbers of the cameras that observed the same people."""
    names = [one.name for one in calibration.cameras]
    pairs = [(pair.camera_a, pair.camera_b) for pair in calibration.pairs if pair.n_matches > 0]
    others = {b if a == camera.name else a for a, b in pairs if camera.name in (a, b)}
    return [number for number, name in enumerate(names) if name in others]


KALIBR = ExportFormat(
    "kalibr", "camera chain of Kalibr, with time shifts", _files, endings=(".yaml", ".yml")
)
