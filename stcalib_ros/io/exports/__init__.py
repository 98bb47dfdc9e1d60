"""The formats that a calibration can be written in, by the command line and by the live node.

A new one is a module of this folder with its `ExportFormat`, and an entry in `EXPORTS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.exports.colmap import COLMAP
from stcalib_ros.io.exports.export_format import Exported, ExportFormat
from stcalib_ros.io.exports.gltf import GLTF
from stcalib_ros.io.exports.kalibr import KALIBR
from stcalib_ros.io.exports.opencv import OPENCV
from stcalib_ros.io.exports.plain import CAMERA_INFO, NPZ, STCALIB
from stcalib_ros.io.exports.static_frames import LAUNCH, URDF
from stcalib_ros.io.exports.toml_cameras import ANIPOSELIB, CALISCOPE
from stcalib_ros.io.files import atomic_path

__all__ = ["EXPORTS", "ExportFormat", "Exported", "exported_files", "write_files"]

EXPORTS: Mapping[str, ExportFormat] = {
    form.name: form
    for form in (
        *(STCALIB, CAMERA_INFO, KALIBR, COLMAP, OPENCV, ANIPOSELIB, CALISCOPE),
        *(URDF, LAUNCH, NPZ, GLTF),
    )
}
"""Formats by name; the first is the default of the live node."""


def exported_files(exported: Exported, form: ExportFormat, path: Path) -> dict[Path, str | bytes]:
    """Return the content of all files of a format by their paths.

    Parameters
    ----------
    exported : Exported
    form : ExportFormat
    path : Path
        The file, or the folder that the files are in.

    Raises
    ------
    InputError
        The format cannot hold it; the message says what, and what to do.
    """
    if form.needs_metres and not exported.calibration.metric:
        raise InputError(
            f"{form.name} has lengths in metres, and this calibration has none: calibrate with "
            "scale.body_height_m or scale.distances, or choose a format without a unit (npz)"
        )
    if form.endings and path.suffix not in form.endings:
        raise InputError(
            f"{str(path)!r}: name a file that ends in {' or '.join(form.endings)} for {form.name}"
        )
    folder = path.parent if form.endings else path
    return {folder / name: content for name, content in form.files(exported, path.name).items()}


def write_files(files: Mapping[Path, str | bytes]) -> None:
    """Write files, each whole or not at all.

    Raises
    ------
    InputError
        The operating system refuses.
    """
    for path, content in files.items():
        with atomic_path(path) as temporary:
            temporary.write_bytes(content.encode() if isinstance(content, str) else content)
