"""Lenses of aniposelib, FreeMoCap, Pose2Sim and Caliscope: one TOML table a camera."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.io.lens_model import fisheye_intrinsics, opencv_intrinsics
from stcalib_ros.io.limits import MAX_COUNT
from stcalib_ros.io.plausible import require_lens
from stcalib_ros.io.yaml_entries import Entry

_CALISCOPE = "cameras"
"""Table that has Caliscope's cameras by their number."""


def toml_lenses(content: Mapping[str, Any], what: str) -> dict[str, Intrinsics]:
    """Lenses by camera, under its name, that of its table, and what these are usually short for.

    Parameters
    ----------
    content : mapping
    what : str
        Begins errors.

    Raises
    ------
    InputError
        There is no camera, or an entry of one is unusable.
    """
    numbered = content.get(_CALISCOPE)
    tables = numbered if isinstance(numbered, Mapping) else content
    cameras = {
        name: Entry(value, f"{what}: {name}")
        for name, value in tables.items()
        if isinstance(value, Mapping) and {"size", "matrix"} <= value.keys()
    }
    if not cameras:
        found = ", ".join(content) or "nothing"
        raise InputError(
            f"{what}: no camera with size and matrix, as aniposelib, Pose2Sim and Caliscope have "
            f"them; there is {found[:200]}"
        )
    own, usual = {}, {}
    for table, entry in cameras.items():
        lens = _lens(entry)
        name = entry.get("name", f"cam_{table}" if table.isdecimal() else table).name()
        own[name] = lens
        usual[table] = lens
        usual[name.removeprefix("int_").removesuffix("_img")] = lens
        if table.isdecimal():
            usual[f"cam{table}"] = lens
    return usual | own


def _lens(camera: Entry) -> Intrinsics:
    size = [round(side.within(MAX_COUNT)) for side in camera.get("size").elements_of(2)]
    K = np.stack([row.numbers(3) for row in camera.get("matrix").elements_of(3)])
    D = camera.get("distortions", []).numbers()
    fisheye = camera.get("fisheye", False).boolean()
    intrinsics = fisheye_intrinsics if fisheye else opencv_intrinsics
    return require_lens(intrinsics(size, K, D), camera.path)
