"""Lenses of COLMAP's text model: ``cameras.txt``, with the names of ``images.txt`` beside it.

COLMAP's pixel centres are at .5, ours at whole numbers: half a pixel less for the principal point.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.io.files import read_bounded
from stcalib_ros.io.limits import MAX_JSON_BYTES, MAX_YAML_LENGTH
from stcalib_ros.io.plausible import require_lens

_CAMERA = re.compile(r"\d+ [A-Z][A-Z0-9_]* \d+ \d+( [-+.\deE]+)+")
_MODELS = {
    "SIMPLE_PINHOLE": (LensModel.PLUMB_BOB, "f cx cy"),
    "PINHOLE": (LensModel.PLUMB_BOB, "fx fy cx cy"),
    "SIMPLE_RADIAL": (LensModel.PLUMB_BOB, "f cx cy k1"),
    "RADIAL": (LensModel.PLUMB_BOB, "f cx cy k1 k2"),
    "OPENCV": (LensModel.PLUMB_BOB, "fx fy cx cy k1 k2 p1 p2"),
    "FULL_OPENCV": (LensModel.RATIONAL_POLYNOMIAL, "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    "OPENCV_FISHEYE": (LensModel.EQUIDISTANT, "fx fy cx cy k1 k2 k3 k4"),
    "SIMPLE_RADIAL_FISHEYE": (LensModel.EQUIDISTANT, "f cx cy k1"),
    "RADIAL_FISHEYE": (LensModel.EQUIDISTANT, "f cx cy k1 k2"),
}
"""Lens model and parameters, in COLMAP's order, of its camera models."""

_COEFFICIENTS = {
    LensModel.PLUMB_BOB: ("k1", "k2", "p1", "p2"),
    LensModel.RATIONAL_POLYNOMIAL: ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    LensModel.EQUIDISTANT: ("k1", "k2", "k3", "k4"),
}
"""Names of D."""

_PIXEL_CENTRE = 0.5
"""Pixels. Where COLMAP has the centre of the first pixel. By its definition."""
_CAMERA_ID, _IMAGE_NAME = 8, 9
"""Columns of images.txt. By its definition."""


def is_colmap(text: str) -> bool:
    """Whether this is the text of a cameras.txt."""
    first = next(_rows(text), "")
    return _CAMERA.fullmatch(" ".join(first.split())) is not None


def colmap_lenses(path: Path) -> dict[str, Intrinsics]:
    """Lenses by camera id, and by the folder or the name of its images where images.txt has one.

    Parameters
    ----------
    path : Path
        The cameras.txt.

    Raises
    ------
    InputError
        A camera has a model that is none of ours, or a line is damaged.
    """
    lenses = {}
    for row in _rows(read_bounded(path, MAX_YAML_LENGTH)):
        camera, *columns = row.split()
        lenses[camera] = _lens(columns, f"{path}: camera {camera}")
    return lenses | _by_image(path.with_name("images.txt"), lenses)


def _rows(text: str) -> Iterator[str]:
    return (line for line in text.splitlines() if line.strip() and not line.startswith("#"))


def _lens(columns: list[str], what: str) -> Intrinsics:
    model, numbers = "".join(columns[:1]), columns[1:]
    if model not in _MODELS:
        raise InputError(
            f"{what}: the model {model} cannot be used: expected one of {', '.join(_MODELS)}"
        )
    lens_model, names = _MODELS[model]
    try:
        width, height = (int(number) for number in numbers[:2])
        values = dict(zip(names.split(), map(float, numbers[2:]), strict=True))
    except ValueError:
        raise InputError(
            f"{what}: expected {model} WIDTH HEIGHT {names}, got {' '.join(numbers)[:80]!r}"
        ) from None
    fx, fy = values.get("fx", values.get("f", 0.0)), values.get("fy", values.get("f", 0.0))
    cx, cy = (values[name] - _PIXEL_CENTRE for name in ("cx", "cy"))
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    D = np.array([values.get(name, 0.0) for name in _COEFFICIENTS[lens_model]])
    return require_lens(Intrinsics(width, height, lens_model, K, D), what)


def _by_image(images: Path, lenses: dict[str, Intrinsics]) -> dict[str, Intrinsics]:
    """Lenses by the one folder, or the one name, of a camera's images; none if ids have several."""
    if not images.is_file():
        return {}
    lines = [x for x in read_bounded(images, MAX_JSON_BYTES).splitlines() if not x.startswith("#")]
    names: dict[str, set[str]] = {}
    for line in lines[::2]:
        columns = line.split(maxsplit=_IMAGE_NAME)
        if len(columns) > _IMAGE_NAME:
            image = PurePosixPath(columns[_IMAGE_NAME])
            folder = image.parent.as_posix()
            name = image.stem if folder == "." else folder
            names.setdefault(columns[_CAMERA_ID], set()).add(name)
    single = {camera: found.pop() for camera, found in names.items() if len(found) == 1}
    return {name: lenses[camera] for camera, name in single.items() if camera in lenses}
