"""CMU Panoptic Studio (Joo et al. 2017), as its toolbox downloads it.

::

    SEQUENCE/calibration_SEQUENCE.json
    SEQUENCE/hdPose3d_stage1_coco19/body3DScene_00000000.json

Lengths are centimetres; the HD cameras are ``00_00`` to ``00_30`` at 29.97 Hz.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.io.datasets.form import (
    Dataset,
    DatasetOptions,
    chosen,
    numbered,
    stacked_people,
)
from stcalib_ros.io.json_files import MALFORMED, read_json

_FPS = 29.97
_CM = 0.01
_JOINTS = 19


def read_panoptic(path: Path, options: DatasetOptions) -> Dataset:
    """Read the HD cameras and the 3D poses of a sequence.

    Raises
    ------
    InputError
        A file is missing or has another form.
    """
    calibrations = sorted(path.glob("calibration_*.json"))
    if not calibrations:
        raise InputError(f"no calibration_*.json in {path}: expected the folder of a sequence")
    content = read_json(calibrations[0])
    try:
        cameras = [c for c in content["cameras"] if c["type"] == "hd"]
        pick = chosen(path, [c["name"] for c in cameras], options.cameras)
        cameras = [cameras[k] for k in pick]
        files = numbered(path / "hdPose3d_stage1_coco19", "body3DScene_*.json", options)
        people = [_people(read_json(file)) for file in files.values()]
        return Dataset(
            path=path,
            names=tuple(c["name"] for c in cameras),
            image_size=np.array([c["resolution"] for c in cameras]),
            K=np.array([c["K"] for c in cameras], dtype=float),
            dist=np.array([c["distCoef"] for c in cameras], dtype=float),
            R=np.array([c["R"] for c in cameras], dtype=float),
            t=np.array([c["t"] for c in cameras], dtype=float).reshape(-1, 3) * _CM,
            fps=_FPS,
            frame_number=np.array(list(files)),
            joint_names=LAYOUTS["coco_19"].joint_names,
            joints_world=stacked_people(people, _JOINTS),
            boxes=np.zeros((0, 7)),
        )
    except MALFORMED as error:
        raise InputError(
            f"{path} is not a Panoptic sequence ({type(error).__name__}: {error})"
        ) from error


def _people(scene: dict[str, Any]) -> dict[int, Float64Array]:
    """Joints (19, 3) in metres by person; joints without confidence are unknown."""
    people = {}
    for body in scene["bodies"]:
        joints = np.array(body["joints19"], dtype=float).reshape(_JOINTS, 4)
        people[int(body["id"])] = np.where(joints[:, 3:] > 0, joints[:, :3] * _CM, np.nan)
    return people
