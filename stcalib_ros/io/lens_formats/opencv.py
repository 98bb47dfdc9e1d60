"""Lenses of OpenCV, under the names that its samples and most programs use.

They are matrices of its FileStorage, or the lists of numbers as which Python programs write them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.io.datasets.opencv_storage import matrix_of
from stcalib_ros.io.json_files import MALFORMED
from stcalib_ros.io.lens_model import fisheye_intrinsics, opencv_intrinsics
from stcalib_ros.io.plausible import require_lens

_K = re.compile(r"(?:camera_?matrix|intrinsic_?matrix|intrinsics|mtx|k|m)_?(.*)", re.IGNORECASE)
_D = re.compile(
    r"(?:distortion_?coefficients|dist_?coeffs|dist_?coefs|distortion|dist|d)_?(.*)", re.IGNORECASE
)
_WIDTH = re.compile(r"(?:image_?width|width|w)_?(.*)", re.IGNORECASE)
_HEIGHT = re.compile(r"(?:image_?height|height|h)_?(.*)", re.IGNORECASE)
_SIZE = re.compile(r"(?:image_?size|img_?size|size)_?(.*)", re.IGNORECASE)
_FISHEYE = re.compile(r"(?:is_?)?fisheye(?:_?model)?_?(.*)", re.IGNORECASE)


def has_matrix(content: Mapping[Any, Any]) -> bool:
    """Whether one of the keys is a camera matrix, or a camera that has one."""
    return bool(_matrices(content) or _cameras(content))


def _cameras(content: Mapping[Any, Any]) -> dict[str, Mapping[Any, Any]]:
    """Cameras of a file that has a mapping for each."""
    values = {str(name): one for name, one in content.items() if isinstance(one, Mapping)}
    return {name: one for name, one in values.items() if _matrices(one)}


def _matrices(content: Mapping[Any, Any]) -> dict[str, str]:
    """Keys of camera matrices by what follows the usual name: the name of the camera, if any."""
    return {name: key for name, key in _keys(content, _K).items() if _is_square(content[key])}


def _is_square(entry: object) -> bool:
    if isinstance(entry, Mapping):
        return (str(entry.get("rows")), str(entry.get("cols"))) == ("3", "3")
    return isinstance(entry, list) and [len(r) for r in entry if isinstance(r, list)] == [3, 3, 3]


def _matrix(entry: object) -> Float64Array:
    return matrix_of(entry) if isinstance(entry, Mapping) else np.array(entry, dtype=np.float64)


def _keys(content: Mapping[Any, Any], usual: re.Pattern[str]) -> dict[str, str]:
    found = {key: usual.fullmatch(key) for key in content if isinstance(key, str)}
    return {match[1]: key for key, match in found.items() if match}


def matrix_lenses(
    content: Mapping[Any, Any], path: Path, image_size: tuple[int, int] | None
) -> dict[str, Intrinsics]:
    """Lenses by camera: the name of the file, of a mapping in it, or what follows ``K_`` and so on.

    Parameters
    ----------
    content : mapping
    path : Path
        Of the file.
    image_size : (int, int) or None
        Width and height where the file does not say them.

    Raises
    ------
    InputError
        An entry is unusable, or nothing says the size of the image.
    """
    if not _matrices(content):
        return {
            name: lens
            for name, one in _cameras(content).items()
            for lens in matrix_lenses(one, path, image_size).values()
        }
    lenses = {}
    for name, key in _matrices(content).items():
        what = f"{path}: {key}"
        try:
            lens = _lens(content, name, key, _size(content, name) or image_size)
        except MALFORMED as error:
            raise InputError(f"{what} cannot be read ({type(error).__name__}: {error})") from error
        if lens is None:
            raise InputError(
                f"{what}: the file has no size of the image: add image_width and image_height, or "
                "image_size, to it, px"
            )
        lenses[name or path.stem] = require_lens(lens, what)
    return lenses


def _lens(
    content: Mapping[Any, Any], name: str, key: str, size: tuple[int, int] | None
) -> Intrinsics | None:
    d_key = _keys(content, _D).get(name)
    K = _matrix(content[key])
    D: Float64Array = np.zeros(0) if d_key is None else _matrix(content[d_key]).ravel()
    if size is None:
        return None
    kinds = _keys(content, _FISHEYE)
    kind = content.get(kinds.get(name, kinds.get("", "")), 0)
    is_fisheye = str(kind).lower() not in ("0", "false", "")
    named = str(content.get("distortion_model", "")).lower()
    if is_fisheye or named in ("fisheye", "equidistant"):
        return fisheye_intrinsics(size, K, D)
    return opencv_intrinsics(size, K, D)


def _size(content: Mapping[Any, Any], name: str) -> tuple[int, int] | None:
    """Width and height of a camera's image, or of all where there is but one."""
    keys = [_keys(content, usual) for usual in (_WIDTH, _HEIGHT, _SIZE)]
    width, height, both = (of.get(name, of.get("")) for of in keys)
    if width is not None and height is not None:
        return round(float(content[width])), round(float(content[height]))
    if both is None:
        return None
    given = content[both]
    values = given["data"] if isinstance(given, Mapping) else given
    sides = tuple(round(float(value)) for value in values)
    return (sides[0], sides[1]) if len(sides) == 2 else None
