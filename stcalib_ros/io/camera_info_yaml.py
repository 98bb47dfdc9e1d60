"""Intrinsics as ``camera_info_manager`` of ROS loads and saves them: one YAML file per camera."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.io.files import make_folder, require_writable, write_text
from stcalib_ros.io.messages import CameraInfoFields, fields_of_lens, lens
from stcalib_ros.io.plausible import require_lens
from stcalib_ros.io.yaml_entries import Entry
from stcalib_ros.io.yaml_files import read_yaml

_NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9_]")
"""What ``camera_info_manager`` refuses in the name of a camera."""


def write_camera_info(calibration: Calibration, folder: Path | str) -> tuple[Path, ...]:
    """Write the intrinsics of every camera to a file of its own, ``<camera>.yaml``.

    They are those of the published image, after binning and region of interest. In the names of
    files and cameras, what is neither letter nor digit becomes an underscore, since
    ``camera_info_manager`` knows no other names.

    Parameters
    ----------
    calibration : Calibration
    folder : Path or str
        Made if it is not there; files of these names are replaced, each whole or not at all.

    Returns
    -------
    tuple of Path
        In the order of the cameras.

    Raises
    ------
    InputError
        A file cannot be written, or two cameras would have the same one.

    Examples
    --------
    >>> import stcalib_ros as st
    >>> truth = st.simulate(st.SceneOptions(n_cameras=2, n_frames=30)).truth
    >>> [path.name for path in st.write_camera_info(truth, "lenses")]
    ['cam0.yaml', 'cam1.yaml']
    """
    names = [camera.name for camera in calibration.cameras]
    paths = require_camera_info_writable(names, Path(folder))
    for path, camera in zip(paths, calibration.cameras, strict=True):
        write_text(path, camera_info_text(camera))
    return paths


def require_camera_info_writable(names: Sequence[str], folder: Path) -> tuple[Path, ...]:
    """Make sure, before the long work, that cameras of these names can be written to a folder.

    Parameters and errors are those of `write_camera_info`, and so is what it returns.
    """
    make_folder(folder)
    paths = tuple(folder / name for name in file_names(names, ".yaml"))
    for path in (*paths, folder / "camera.yaml"):
        require_writable(path)
    return paths


def file_names(cameras: Sequence[str], ending: str) -> tuple[str, ...]:
    """Return the name of a file for each camera.

    Raises
    ------
    InputError
        Two cameras would have the same one.
    """
    names = tuple(_plain_name(camera) + ending for camera in cameras)
    name, n = max(Counter(names).items(), key=lambda item: item[1], default=("", 1))
    if n > 1:
        same = [camera for camera, own in zip(cameras, names, strict=True) if own == name]
        raise InputError(f"cameras {', '.join(same)} would have one file, {name}: rename one")
    return names


def _plain_name(camera: str) -> str:
    return _NOT_IN_NAMES.sub("_", camera)


def camera_info_text(camera: CameraCalibration) -> str:
    """Text of the file of a camera."""
    info = fields_of_lens(camera.intrinsics)
    content = {
        "image_width": info.width,
        "image_height": info.height,
        "camera_name": _plain_name(camera.name),
        "camera_matrix": _matrix(info.k, 3),
        "distortion_model": info.distortion_model,
        "distortion_coefficients": _matrix(info.d, 1),
        "rectification_matrix": _matrix(info.r, 3),
        "projection_matrix": _matrix(info.p, 3),
    }
    return str(yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=110))


def _matrix(values: tuple[float, ...], rows: int) -> dict[str, Any]:
    return {"rows": rows, "cols": len(values) // rows, "data": list(values)}


def read_camera_info_yaml(path: Path) -> tuple[str, Intrinsics]:
    """Read the camera's name and its lens, for the raw image, from a file of such a form.

    Parameters
    ----------
    path : Path

    Returns
    -------
    name : str
    lens : Intrinsics
        Not known, but for the size of the image, where the matrix is zero.

    Raises
    ------
    InputError
        The file cannot be read, or an entry is missing or unusable; the message names it.
    """
    name, fields = read_camera_info_fields(path)
    return name, lens(fields, rectified=False, topic=str(path))


def read_camera_info_fields(path: Path) -> tuple[str, CameraInfoFields]:
    """Read the camera's name and its CameraInfo; parameters and errors as above.

    Raises
    ------
    InputError
        As of `read_camera_info_yaml`.
    """
    return fields_of_content(read_yaml(path), path)


def fields_of_content(content: Any, path: Path) -> tuple[str, CameraInfoFields]:
    """Return the camera's name and its CameraInfo from the content of such a file.

    Parameters
    ----------
    content : object
        As of `stcalib_ros.io.yaml_files.read_yaml`.
    path : Path
        For errors.

    Raises
    ------
    InputError
        As of `read_camera_info_yaml`.
    """
    top = Entry(content, str(path), ": ")
    roi = top.get("roi", {})
    x, y, width, height = (
        roi.get(side, 0).count() for side in ("x_offset", "y_offset", "width", "height")
    )
    fields = CameraInfoFields(
        width=top.get("image_width").count(),
        height=top.get("image_height").count(),
        distortion_model=top.get("distortion_model", LensModel.PLUMB_BOB.value).text(),
        d=_numbers(top.get("distortion_coefficients")),
        k=_numbers(top.get("camera_matrix")),
        r=_numbers(top.get("rectification_matrix")),
        p=_numbers(top.get("projection_matrix")),
        binning_x=top.get("binning_x", 0).count(),
        binning_y=top.get("binning_y", 0).count(),
        roi=(x, y, width, height),
    )
    given = lens(fields, rectified=False, topic=str(path))
    if given.known:
        require_lens(given, str(path))
    return top.get("camera_name", "unknown").name(), fields


def _numbers(entry: Entry) -> tuple[float, ...]:
    rows, cols = entry.get("rows").count(), entry.get("cols").count()
    values = entry.get("data").numbers()
    if values.size != rows * cols:
        raise InputError(f"{entry.path}.data: expected {rows} x {cols} numbers, got {values.size}")
    return tuple(values.tolist())
