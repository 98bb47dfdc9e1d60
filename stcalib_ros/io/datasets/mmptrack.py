"""MMPTRACK (Han et al. 2023).

::

    ROOT/labels/SESSION/SCENE/rgb_00000_1.json        {"person": [left, top, right, bottom]}
    ROOT/calibrations/ENVIRONMENT/calibrations.json   SCENE without its number

The source is the folder of a scene's labels. Cameras are 1, 2, ... with images of 640 x 360;
lengths are millimetres, and the extrinsics lead from the camera to the world.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.io.datasets.form import Dataset, DatasetOptions, chosen
from stcalib_ros.io.json_files import MALFORMED, read_json

_SIZE = (640, 360)
_MM = 0.001
_LEVELS = 3
"""Folders above that of a scene, down from ROOT."""


def read_mmptrack(path: Path, options: DatasetOptions) -> Dataset:
    """Read cameras and boxes of a scene; it has no poses.

    Raises
    ------
    InputError
        A file is missing or has another form.
    """
    above = path.absolute().parents
    if len(above) < _LEVELS:
        raise InputError(f"{path} is not an MMPTRACK scene: expected ROOT/labels/SESSION/SCENE")
    environment = path.name.rstrip("0123456789").rstrip("_")
    calibration = above[_LEVELS - 1] / "calibrations" / environment / "calibrations.json"
    content = read_json(calibration)
    try:
        cameras = {str(c["CameraId"]): c for c in content["Cameras"]}
        names = [list(cameras)[k] for k in chosen(calibration, list(cameras), options.cameras)]
        R = np.stack([_rotation(cameras[name]) for name in names])
        centre = np.array([cameras[n]["ExtrinsicParameters"]["Translation"] for n in names])
        boxes, numbers = _boxes(path, names, options)
        return Dataset(
            path=path,
            names=tuple(f"cam{name}" for name in names),
            image_size=np.tile(_SIZE, (len(names), 1)),
            K=np.stack([_pinhole(cameras[name]["IntrinsicParameters"]) for name in names]),
            dist=np.zeros((len(names), 5)),
            R=R,
            t=-np.einsum("cij,cj->ci", R, centre.astype(float) * _MM),
            fps=float("nan"),
            frame_number=np.array(numbers),
            joint_names=(),
            joints_world=np.zeros((len(numbers), 0, 0, 3)),
            boxes=boxes,
        )
    except MALFORMED as error:
        raise InputError(
            f"{path} is not an MMPTRACK scene ({type(error).__name__}: {error})"
        ) from error


def _rotation(camera: dict[str, Any]) -> Float64Array:
    """World to camera: the file has the inverse, row by row."""
    R_world_cam: Float64Array = np.array(camera["ExtrinsicParameters"]["Rotation"], dtype=float)
    return np.asarray(R_world_cam.reshape(3, 3).T)


def _pinhole(given: dict[str, Any]) -> Float64Array:
    return np.array([[given["Fx"], 0, given["Cx"]], [0, given["Fy"], given["Cy"]], [0, 0, 1.0]])


def _boxes(path: Path, names: list[str], options: DatasetOptions) -> tuple[Float64Array, list[int]]:
    """Boxes (N, 7) as in `Dataset`, and the numbers of the frames."""
    labels: dict[tuple[int, int], dict[str, Any]] = {}
    for c, name in enumerate(names):
        files = {
            int(file.stem.split("_")[1]): file for file in sorted(path.glob(f"rgb_*_{name}.json"))
        }
        labels |= {(n, c): read_json(file) for n, file in files.items() if options.has(n)}
    numbers = sorted({n for n, _ in labels})
    if not numbers:
        raise InputError(f"no rgb_*_{names[0]}.json with a wanted frame number in {path}")
    index = {n: f for f, n in enumerate(numbers)}
    rows = [
        (index[n], c, int(person), *box)
        for (n, c), found in labels.items()
        for person, box in found.items()
    ]
    return np.array(rows, dtype=float).reshape(-1, 7), numbers
