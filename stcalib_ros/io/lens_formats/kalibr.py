"""Lenses of Kalibr: ``camchain-*.yaml``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.io.plausible import require_lens
from stcalib_ros.io.yaml_entries import Entry

_DISTORTIONS = {
    "radtan": LensModel.PLUMB_BOB,
    "equi": LensModel.EQUIDISTANT,
    "equidistant": LensModel.EQUIDISTANT,
    "none": LensModel.PLUMB_BOB,
}


def is_camchain(content: Mapping[Any, Any]) -> bool:
    """Whether this is the content of a camchain."""
    return any(_is_camera(value) for value in content.values())


def _is_camera(value: Any) -> bool:
    return isinstance(value, Mapping) and {"camera_model", "intrinsics"} <= value.keys()


def camchain_lenses(content: Mapping[Any, Any], what: str) -> dict[str, Intrinsics]:
    """Lenses by camera: under the name in the file, and the namespace of its topic.

    Parameters
    ----------
    content : mapping
    what : str
        Begins errors.

    Raises
    ------
    InputError
        A camera has another model than pinhole with radtan or equi, or an entry is unusable.
    """
    cameras = {
        str(name): Entry(value, f"{what}: {name}")
        for name, value in content.items()
        if _is_camera(value)
    }
    lenses = {name: _lens(entry) for name, entry in cameras.items()}
    topics = {name: entry.get("rostopic", "/").text() for name, entry in cameras.items()}
    by_topic = {topics[name].strip("/").rpartition("/")[0]: lens for name, lens in lenses.items()}
    by_topic.pop("", None)
    return lenses | by_topic if len(by_topic) == len(lenses) else lenses


def _lens(camera: Entry) -> Intrinsics:
    model = camera.get("camera_model").text()
    distortion = camera.get("distortion_model", "none").text()
    if model != "pinhole" or distortion not in _DISTORTIONS:
        raise InputError(
            f"{camera.path}: the model {model}-{distortion} cannot be used: calibrate with "
            "pinhole-radtan, or with pinhole-equi for a wide lens (--models of Kalibr)"
        )
    fx, fy, cx, cy = camera.get("intrinsics").numbers(4)
    width, height = (side.count() for side in camera.get("resolution").elements_of(2))
    D = np.zeros(0) if distortion == "none" else camera.get("distortion_coeffs").numbers(4)
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return require_lens(Intrinsics(width, height, _DISTORTIONS[distortion], K, D), camera.path)
