"""The arrays of a multi-view file: which there are, their kinds, shapes and ranges."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.limits import MAX_COUNT, MAX_DISTANCE, MAX_KEYPOINT_PX, MAX_TABLE
from stcalib_ros.io.plausible import require_position, require_rotation

Arrays = Mapping[str, NDArray[Any]]

_TEXTS = ("camera_names", "kp_names", "kp3d_names")
_INDICES = ("image_size", "frame_number", "det_frame", "det_camera", "det_track", "det_person")
_NUMBERS = ("K", "dist", "R", "t", "fps", "det_kp2d", "det_kp3d")
_OPTIONAL = ("det_kp3d", "kp3d_names", "K", "dist", "R", "t", "det_track", "det_person", "fps")
_TOGETHER = (("R", "t"), ("t", "R"), ("R", "K"), ("dist", "K"))
"""Arrays of which the first says nothing without the second."""
_COEFFICIENTS = 5
"""Distortion coefficients that are 0 where a file has a matrix and none, count. Chosen."""


def checked_arrays(path: Path, given: Arrays) -> dict[str, NDArray[Any]]:
    """Return the arrays of a multi-view file, each of its kind and shape.

    Parameters
    ----------
    path : Path
        The source, for messages.
    given : mapping of str to ndarray
        As in `stcalib_ros.io.convert.convert_npz`.

    Raises
    ------
    InputError
        One is missing, has another kind or shape than the others ask for, or values that no
        camera, frame, track or joint has.
    """
    needed = [name for name in (*_TEXTS, *_INDICES, *_NUMBERS) if name not in _OPTIONAL]
    if missing := [name for name in needed if name not in given]:
        raise InputError(f"{path} is not a multi-view file: it lacks {', '.join(missing)}")
    for name, other in _TOGETHER:
        if name in given and other not in given:
            raise InputError(f"{path} is not a multi-view file: it has {name}, but lacks {other}")
    arrays = {name: _of_kind(path, name, array) for name, array in given.items()}
    arrays = _defaults(arrays) | arrays
    arrays["det_track"] = _own_ids(arrays["det_track"])
    _require_shapes(path, arrays)
    _require_ranges(path, arrays)
    return arrays


def _own_ids(tracks: NDArray[Any]) -> NDArray[Any]:
    """Return the ids, where -1, that of nobody, is a new one each time."""
    nobody = tracks == -1
    new = max(int(tracks.max(initial=-1)), -1) + np.cumsum(nobody)
    return np.where(nobody, new, tracks)


def _defaults(arrays: Arrays) -> dict[str, NDArray[Any]]:
    """Return what is not known: the rate, distortion, who anybody is, and ids of nobody."""
    n = arrays["det_frame"].size
    unknown: dict[str, NDArray[Any]] = {
        "fps": np.array(np.nan),
        "det_track": np.arange(n),
        "det_person": np.full(n, -1),
    }
    if "K" in arrays:
        unknown["dist"] = np.zeros((arrays["camera_names"].size, _COEFFICIENTS))
    return unknown


def _of_kind(path: Path, name: str, array: NDArray[Any]) -> NDArray[Any]:
    """Return an array as text, int64 or float64; others, which are not used, as they are."""
    if name in _TEXTS and array.dtype.kind == "S":
        array = np.char.decode(array, "utf-8", "replace")
    if name == "fps" and array.size == 1:
        array = array.reshape(())
    kind = array.dtype.kind
    if name in _TEXTS and kind != "U":
        raise InputError(f"{path}: {name} must be text, got {array.dtype}")
    if name in _INDICES:
        if kind not in "iuf" or not np.all(np.abs(array.astype(np.float64)) <= MAX_COUNT):
            raise InputError(f"{path}: {name} must be whole numbers up to {MAX_COUNT}")
        return array.astype(np.int64)
    if name in _NUMBERS:
        if kind not in "iuf":
            raise InputError(f"{path}: {name} must be numbers, got {array.dtype}")
        return array.astype(np.float64)
    return array


def _require_shapes(path: Path, arrays: Arrays) -> None:
    C, F, J = (arrays[name].size for name in ("camera_names", "frame_number", "kp_names"))
    N = arrays["det_frame"].size
    if not (C and F and J):
        raise InputError(f"{path}: camera_names, frame_number or kp_names is empty")
    shapes: dict[str, tuple[int, ...]]
    shapes = {"camera_names": (C,), "frame_number": (F,), "kp_names": (J,), "fps": ()}
    shapes["image_size"] = (C, 2)
    per_camera = {"K": (C, 3, 3), "R": (C, 3, 3), "t": (C, 3)}
    shapes |= {name: shape for name, shape in per_camera.items() if name in arrays}
    if "dist" in arrays:
        shapes["dist"] = (C, *arrays["dist"].shape[1:])
    if "kp3d_names" in arrays:
        shapes["kp3d_names"] = (arrays["kp3d_names"].size,)
    shapes |= dict.fromkeys(("det_frame", "det_camera", "det_track", "det_person"), (N,))
    poses = [name for name in ("det_kp2d", "det_kp3d") if name in arrays]
    shapes |= dict.fromkeys(poses, (N, J, 3))
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise InputError(f"{path}: {name} has shape {arrays[name].shape}, expected {shape}")


def _require_ranges(path: Path, arrays: Arrays) -> None:
    C, F = len(arrays["camera_names"]), len(arrays["frame_number"])
    for name, end in (("det_camera", C), ("det_frame", F), ("det_track", MAX_COUNT + 1)):
        values = arrays[name]
        if values.size and not (values.min() >= 0 and values.max() < end):
            raise InputError(f"{path}: {name} must be indices from 0 to {end - 1}")
    if not (np.diff(arrays["frame_number"]) > 0).all() or C * F > MAX_TABLE:
        raise InputError(f"{path}: frame_number must increase, with at most {MAX_TABLE} images")
    for name, limit in (("det_kp2d", MAX_KEYPOINT_PX), ("det_kp3d", MAX_DISTANCE)):
        values = arrays.get(name, np.zeros(0))
        if (np.abs(values[np.isfinite(values)]) > limit).any():
            raise InputError(f"{path}: {name} has numbers beyond {limit:g}")
    points = arrays["det_kp2d"][..., :2]
    if 0 < np.abs(points[np.isfinite(points)]).max(initial=0.0) <= 1:
        raise InputError(
            f"{path}: det_kp2d is within 1 px of the corner of the image, as if keypoints were "
            "fractions of it: write them in pixels"
        )
    for c, camera in enumerate(arrays["camera_names"] if "R" in arrays else ()):
        require_rotation(arrays["R"][c], f"{path}: R of camera {camera}")
        require_position(arrays["t"][c], f"{path}: t of camera {camera}")
