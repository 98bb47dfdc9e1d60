"""Camera rigs from JSON files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.core.synthetic import SceneRig
from stcalib_ros.io.json_files import MALFORMED, read_json
from stcalib_ros.io.lens_model import opencv_intrinsics
from stcalib_ros.io.plausible import (
    require_lens,
    require_name,
    require_position,
    require_rotation,
)


def read_rig(path: Path) -> SceneRig:
    """Read the cameras of a real rig.

    The file is a JSON object; its ``cameras`` are objects with ``name``, ``image_size`` (width,
    height), ``K``, ``dist`` (OpenCV's order) and ``R``, ``t``: ``x_cam = R x_world + t``, metres.

    Raises
    ------
    InputError
        The file cannot be read or has another form.
    """
    content = read_json(path)
    try:
        cameras = content["cameras"]
        return SceneRig(
            names=tuple(require_name(str(c["name"]), f"{path}: name") for c in cameras),
            intrinsics=tuple(_lens(path, c) for c in cameras),
            R_cam_world=np.array([_rotation(path, c) for c in cameras], dtype=np.float64),
            t_cam_world=np.array([_position(path, c) for c in cameras], dtype=np.float64),
        )
    except MALFORMED as error:
        raise InputError(f"{path} is not a camera rig ({type(error).__name__}: {error})") from error


def _lens(path: Path, camera: dict[str, Any]) -> Intrinsics:
    K = np.array(camera["K"], dtype=np.float64).reshape(3, 3)
    dist = np.array(camera["dist"], dtype=np.float64)
    lens = opencv_intrinsics(camera["image_size"], K, dist)
    return require_lens(lens, f"{path}: camera {camera['name']}")


def _rotation(path: Path, camera: dict[str, Any]) -> Float64Array:
    R = np.array(camera["R"], dtype=np.float64).reshape(3, 3)
    return require_rotation(R, f"{path}: R of camera {camera['name']}")


def _position(path: Path, camera: dict[str, Any]) -> Float64Array:
    t = np.array(camera["t"], dtype=np.float64).reshape(3)
    return require_position(t, f"{path}: t of camera {camera['name']}")
