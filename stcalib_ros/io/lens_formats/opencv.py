"""Lenses of OpenCV's FileStorage, under the names that its samples and most programs use."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.io.datasets.opencv_storage import OpencvStorage
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
    """Whether one of the keys is a camera matrix."""
    return bool(_matrices(content))


def _matrices(content: Mapping[Any, Any]) -> dict[str, str]:
    """Keys of camera matrices by what follows the usual name: the name of the camera, if any."""
    return {
        name: key
        for name, key in _keys(content, _K).items()
        if isinstance(content[key], Mapping) and _sides(content[key]) == ("3", "3")
    }


def _sides(matrix: Mapping[Any, Any]) -> tuple[str, str]:
    return str(matrix.get("rows")), str(matrix.get("cols"))


def _keys(content: Mapping[Any, Any], usual: re.Pattern[str]) -> dict[str, str]:
    found = {key: usual.fullmatch(key) for key in content if isinstance(key, str)}
    return {match[1]: key for key, match in found.items() if match}


def storage_lenses(
    storage: OpencvStorage, path: Path, image_size: tuple[int, int] | None
) -> dict[str, Intrinsics]:
    """Lenses by camera: the name of the file, or what follows ``K_`` and the like.

    Parameters
    ----------
    storage : OpencvStorage
    path : Path
        Of the file.
    image_size : (int, int) or None
        Width and height where the file does not say them.

    Raises
    ------
    InputError
        An entry is unusable, or nothing says the size of the image.
    """
    lenses = {}
    for name, key in _matrices(storage.content).items():
        what = f"{path}: {key}"
        try:
            lens = _lens(storage, name, key, _size(storage, name) or image_size)
        except MALFORMED as error:
            raise InputError(f"{what} cannot be read ({type(error).__name__}: {error})") from error
        if lens is None:
            raise InputError(
                f"{what}: the file has no size of the image: add image_width: and image_height: "
                "to it, px"
            )
        lenses[name or path.stem] = require_lens(lens, what)
    return lenses


def _lens(
    storage: OpencvStorage, name: str, key: str, size: tuple[int, int] | None
) -> Intrinsics | None:
    d_key = _keys(storage.content, _D).get(name)
    K = storage.matrix(key)
    D: Float64Array = np.zeros(0) if d_key is None else storage.matrix(d_key).ravel()
    if size is None:
        return None
    kinds = _keys(storage.content, _FISHEYE)
    kind = storage.content.get(kinds.get(name, kinds.get("", "")), 0)
    is_fisheye = str(kind).lower() not in ("0", "false", "")
    named = str(storage.content.get("distortion_model", "")).lower()
    if is_fisheye or named in ("fisheye", "equidistant"):
        return fisheye_intrinsics(size, K, D)
    return opencv_intrinsics(size, K, D)


def _size(storage: OpencvStorage, name: str) -> tuple[int, int] | None:
    """Width and height of a camera's image, or of all where there is but one."""
    keys = [_keys(storage.content, usual) for usual in (_WIDTH, _HEIGHT, _SIZE)]
    width, height, both = (of.get(name, of.get("")) for of in keys)
    if width is not None and height is not None:
        return round(storage.number(width)), round(storage.number(height))
    if both is None:
        return None
    given = storage.content[both]
    values = given["data"] if isinstance(given, Mapping) else given
    sides = tuple(round(float(value)) for value in values)
    return (sides[0], sides[1]) if len(sides) == 2 else None
