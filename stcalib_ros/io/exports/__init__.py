"""The formats that a calibration can be written in, by the command line and by the live node.

A new one is a module of this folder with its `ExportFormat`, and an entry in `EXPORTS`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory
from stcalib_ros.io.exports.colmap import COLMAP
from stcalib_ros.io.exports.export_format import Exported, ExportFormat
from stcalib_ros.io.exports.gltf import GLTF
from stcalib_ros.io.exports.kalibr import KALIBR
from stcalib_ros.io.exports.opencv import OPENCV
from stcalib_ros.io.exports.plain import CAMERA_INFO, NPZ, STCALIB
from stcalib_ros.io.exports.static_frames import LAUNCH, URDF
from stcalib_ros.io.exports.toml_cameras import ANIPOSELIB, CALISCOPE
from stcalib_ros.io.files import atomic_path, make_folder, require_writable

__all__ = [
    "EXPORTS",
    "ExportFormat",
    "Exported",
    "export_calibration",
    "export_format",
    "exported_files",
    "write_files",
]

EXPORTS: Mapping[str, ExportFormat] = {
    form.name: form
    for form in (
        *(STCALIB, CAMERA_INFO, KALIBR, COLMAP, OPENCV, ANIPOSELIB, CALISCOPE),
        *(URDF, LAUNCH, NPZ, GLTF),
    )
}
"""Formats by name; the first is the default of the live node."""


def export_calibration(
    calibration: Calibration,
    path: Path | str,
    form: str,
    people: Sequence[PersonTrajectory] = (),
) -> tuple[Path, ...]:
    """Write a calibration in the format of another program.

    Parameters
    ----------
    calibration : Calibration
    path : Path or str
        The file, or the folder of files, which is made if it is not there. What is there of these
        names is replaced, each file whole or not at all.
    form : str
        Name of the format, as ``stcalib export --help`` has it.
    people : sequence of PersonTrajectory
        In the frame and unit of the calibration; for formats that have a place for them.

    Returns
    -------
    tuple of Path
        The files.

    Raises
    ------
    InputError
        There is no such format, it cannot hold the calibration, or a file cannot be written.

    Examples
    --------
    >>> import stcalib_ros as st
    >>> truth = st.simulate(st.SceneOptions(n_cameras=2, n_frames=30)).truth
    >>> [path.name for path in st.export_calibration(truth, "sparse", "colmap")]
    ['cameras.txt', 'images.txt', 'points3D.txt']
    """
    path = Path(path)
    known = export_format(form)
    files = exported_files(Exported(calibration, people), known, path)
    if not known.endings:
        make_folder(path)
    for file in files:
        require_writable(file)
    write_files(files)
    return tuple(files)


def export_format(name: str) -> ExportFormat:
    """Return a format by its name.

    Raises
    ------
    InputError
        There is none of that name; the message says which there are.
    """
    if name not in EXPORTS:
        raise InputError(f"format {name!r} is unknown; there is {', '.join(EXPORTS)}")
    return EXPORTS[name]


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
    if form.endings and path.suffix.lower() not in form.endings:
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
