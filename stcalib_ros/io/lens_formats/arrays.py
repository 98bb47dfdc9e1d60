"""Lenses in NumPy's ``.npz``: of Python programs, and of ``stcalib export --format npz``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.io.lens_formats.opencv import has_matrix, matrix_lenses
from stcalib_ros.io.npz_files import read_npz

_OF_ALL = ("K", "dist", "image_size")
"""Arrays with a row for each of ``camera_names``."""


def array_lenses(path: Path, image_size: tuple[int, int] | None) -> dict[str, Intrinsics]:
    """Lenses by camera: those of ``camera_names``, or one of the name of the file.

    Parameters
    ----------
    path : Path
    image_size : (int, int) or None
        Width and height where the file does not say them.

    Raises
    ------
    InputError
        The file cannot be read, has no camera matrix (mtx, K, camera_matrix) or a damaged one, or
        nothing says the size of the image.
    """
    arrays = read_npz(path)
    content = _by_camera(path, arrays) if "camera_names" in arrays else _lists(arrays)
    if not has_matrix(content):
        raise InputError(
            f"{path} has no camera matrix (mtx, K or camera_matrix), but {', '.join(arrays)[:200]}"
        )
    return matrix_lenses(content, path, image_size)


def _lists(arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    return {name: array.tolist() for name, array in arrays.items()}


def _by_camera(path: Path, arrays: Mapping[str, NDArray[Any]]) -> dict[str, dict[str, Any]]:
    names = [str(name) for name in arrays["camera_names"].ravel()]
    there = {key: arrays[key] for key in _OF_ALL if key in arrays}
    if any(array.ndim == 0 or len(array) != len(names) for array in there.values()):
        raise InputError(f"{path}: expected a row for each of {len(names)} cameras in K and dist")
    cameras = {
        name: {key: array[c].tolist() for key, array in there.items()}
        for c, name in enumerate(names)
    }
    models = arrays["dist_model"].ravel().tolist() if "dist_model" in arrays else []
    for name, model in zip(names, models, strict=False):
        cameras[name]["fisheye"] = model == LensModel.EQUIDISTANT.value
    return cameras
