"""Camera rigs from JSON files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.core.synthetic import SceneRig
from stcalib_ros.io.lens_model import opencv_intrinsics


def read_rig(path: Path) -> SceneRig:
    """Read the cameras of a real rig.

    The file is a JSON object; its ``cameras`` are objects with ``name``, ``image_size`` (width,
    height), ``K``, ``dist`` (OpenCV's order) and ``R``, ``t``: ``x_cam = R x_world + t``, metres.

    Raises
    ------
    InputError
        The file cannot be read or has another form.
    """
    try:
        cameras = json.loads(path.read_text(encoding="utf-8"))["cameras"]
        return SceneRig(
            names=tuple(str(c["name"]) for c in cameras),
            intrinsics=tuple(_lens(c) for c in cameras),
            R_cam_world=np.array([c["R"] for c in cameras], dtype=np.float64),
            t_cam_world=np.array([c["t"] for c in cameras], dtype=np.float64),
        )
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path} is not a camera rig ({type(error).__name__}: {error})") from error


def _lens(camera: dict[str, Any]) -> Intrinsics:
    K = np.array(camera["K"], dtype=np.float64).reshape(3, 3)
    return opencv_intrinsics(camera["image_size"], K, np.array(camera["dist"], dtype=np.float64))
