"""EasyMocap's layout, in which ZJU-MoCap's scenes of several people come.

::

    SCENE/intri.yml  SCENE/extri.yml            OpenCV's FileStorage: K_, dist_, R_ (Rodrigues), T_
    SCENE/annots/CAMERA/000000.json             boxes and persons, height and width of the images
    SCENE/keypoints3d/000000.json               body_25 joints by person; also under output*/

Lengths are metres. Either of the last two may be missing.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.io.datasets.form import (
    Dataset,
    DatasetOptions,
    chosen,
    numbered,
    stacked_people,
)
from stcalib_ros.io.datasets.opencv_storage import OpencvStorage
from stcalib_ros.io.json_files import MALFORMED, read_json

_JOINTS = 25
_KEYPOINTS_3D = ("keypoints3d", "output/keypoints3d", "output-keypoints3d/keypoints3d")


def read_easymocap(path: Path, options: DatasetOptions) -> Dataset:
    """Read cameras, boxes and 3D poses of a scene.

    Raises
    ------
    InputError
        A file is missing or has another form.
    """
    intri, extri = OpencvStorage(path / "intri.yml"), OpencvStorage(path / "extri.yml")
    try:
        all_names = intri.names("names")
        names = [all_names[k] for k in chosen(path, all_names, options.cameras)]
        annots = _annotations(path, names, options)
        people = _people(path, options)
        numbers = sorted(people or {n for of_camera in annots for n in of_camera})
        if not numbers:
            raise InputError(f"{path} has neither annots/ nor keypoints3d/ of the wanted frames")
        return Dataset(
            path=path,
            names=tuple(names),
            image_size=_image_size(path, names, annots, intri),
            K=np.stack([intri.matrix(f"K_{name}") for name in names]),
            dist=np.stack([intri.matrix(f"dist_{name}").ravel()[:5] for name in names]),
            R=np.stack([cv2.Rodrigues(extri.matrix(f"R_{name}"))[0] for name in names]),
            t=np.stack([extri.matrix(f"T_{name}").ravel() for name in names]),
            fps=float("nan"),
            frame_number=np.array(numbers),
            joint_names=LAYOUTS["body_25"].joint_names if people else (),
            joints_world=stacked_people([people[n] for n in people], _JOINTS),
            boxes=_boxes(annots, numbers),
        )
    except (*MALFORMED, cv2.error) as error:
        raise InputError(
            f"{path} is not an EasyMocap scene ({type(error).__name__}: {error})"
        ) from error


def _annotations(
    path: Path, names: list[str], options: DatasetOptions
) -> list[dict[int, dict[str, Any]]]:
    """Annotations of each camera by frame number; empty where there is no folder."""
    found = []
    for name in names:
        folder = path / "annots" / name
        files = numbered(folder, "*.json", options) if folder.is_dir() else {}
        found.append({n: read_json(file) for n, file in files.items()})
    return found


def _people(path: Path, options: DatasetOptions) -> dict[int, dict[int, Float64Array]]:
    """Joints (25, 3) by frame number and person; empty where there is no folder."""
    folder = next((path / f for f in _KEYPOINTS_3D if (path / f).is_dir()), None)
    if folder is None:
        return {}
    return {n: _persons(read_json(file)) for n, file in numbered(folder, "*.json", options).items()}


def _persons(content: list[dict[str, Any]]) -> dict[int, Float64Array]:
    people = {}
    for person in content:
        joints = np.array(person["keypoints3d"], dtype=float)[:_JOINTS]
        people[int(person["id"])] = np.where(joints[:, 3:4] > 0, joints[:, :3], np.nan)
    return people


def _image_size(
    path: Path,
    names: list[str],
    annots: list[dict[int, dict[str, Any]]],
    intri: OpencvStorage,
) -> IntArray:
    sizes = []
    for name, of_camera in zip(names, annots, strict=True):
        first = next(iter(of_camera.values()), {})
        width = first.get("width") or intri.number(f"W_{name}")
        height = first.get("height") or intri.number(f"H_{name}")
        if not width or not height:
            raise InputError(f"{path}: neither annots/{name} nor intri.yml gives the image size")
        sizes.append((int(width), int(height)))
    return np.array(sizes)


def _boxes(annots: list[dict[int, dict[str, Any]]], numbers: list[int]) -> Float64Array:
    index = {n: f for f, n in enumerate(numbers)}
    rows = [
        (index[n], c, person["personID"], *person["bbox"][:4])
        for c, of_camera in enumerate(annots)
        for n, content in of_camera.items()
        if n in index
        for person in content["annots"]
    ]
    return np.array(rows, dtype=float).reshape(-1, 7)
