"""Lenses from the files of any program, recognised by their content."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.io.camera_info_yaml import fields_of_content
from stcalib_ros.io.datasets.opencv_storage import OpencvStorage
from stcalib_ros.io.files import read_bounded
from stcalib_ros.io.lens_formats.colmap import colmap_lenses, is_colmap
from stcalib_ros.io.lens_formats.kalibr import camchain_lenses, is_camchain
from stcalib_ros.io.lens_formats.opencv import has_matrix, storage_lenses
from stcalib_ros.io.lens_formats.toml import toml_lenses
from stcalib_ros.io.limits import MAX_QUOTED, MAX_YAML_LENGTH
from stcalib_ros.io.messages import CameraInfoFields, fields_of_lens, lens
from stcalib_ros.io.results import read_result
from stcalib_ros.io.toml_files import read_toml

LENS_FORMATS = (
    "camera_info YAML",
    "a Kalibr camchain",
    "OpenCV's FileStorage (YAML, XML)",
    "aniposelib, Pose2Sim or Caliscope TOML",
    "COLMAP's cameras.txt",
    "a result of stcalib",
)
"""What is recognised, in words."""
_EXPECTED = f"lenses are read from {', '.join(LENS_FORMATS[:-1])} or {LENS_FORMATS[-1]}"

_ENDINGS = (".yaml", ".yml", ".xml", ".toml", ".txt", ".json")
_WHOLE = ("cameras.txt", "camera_array.toml", "intri.yml")
"""Files that have all cameras of the folder that they are in."""
_CAMERA_INFO = {"distortion_model", "rectification_matrix", "projection_matrix", "camera_name"}
_TOML = re.compile(r"\[[^\[\],]+\]|[\w.-]+\s*=.*")
"""First line of a TOML file that is no comment: a table or a value."""
_NO_P = (0.0,) * 12
"""P of a file that knows no rectified image: nothing is guessed for rectified keypoints."""
_NOT_IN_NAMES = re.compile(r"\W")
_SHOWN = 5
"""Keys of a file that is not recognised which the error shows: they fit on a line. Chosen."""


def read_lenses(path: Path, *, image_size: tuple[int, int] | None = None) -> dict[str, Intrinsics]:
    """Read the lens of every camera from a file, or from a folder with a file a camera.

    Parameters
    ----------
    path : Path
    image_size : (int, int), optional
        Width and height, px, where a file does not say them.

    Returns
    -------
    dict of str to Intrinsics
        By the camera's name. A camera may be under several names: that in the file, and what it is
        short for. `lenses_of` finds those of given cameras.

    Raises
    ------
    InputError
        The file is none of `LENS_FORMATS`, or an entry of it is unusable; the message names it.
    """
    fields = read_lens_fields(path, image_size=image_size)
    return {
        name: lens(info, rectified=False, topic=f"{path}: {name}") for name, info in fields.items()
    }


def lenses_of(
    path: Path, cameras: Sequence[str], *, image_size: tuple[int, int] | None = None
) -> dict[str, Intrinsics]:
    """Read the lenses of given cameras.

    Parameters
    ----------
    path : Path
    cameras : sequence of str
        Their names. If the file has one lens under another name, it is that of all of them.
    image_size : (int, int), optional
        As of `read_lenses`.

    Raises
    ------
    InputError
        As of `read_lenses`, or a camera is not in the file.
    """
    fields = read_lens_fields(path, image_size=image_size)
    found = fields_by_camera(fields, cameras)
    if missing := [name for name in cameras if name not in found]:
        raise InputError(
            f"{path} has no lens of {', '.join(missing)}: it has {', '.join(fields)}; rename "
            "cameras there, so that the names are the same"
        )
    return {
        name: lens(info, rectified=False, topic=f"{path}: {name}") for name, info in found.items()
    }


def read_lens_of(given: str, camera: str) -> CameraInfoFields:
    """Read the lens of one camera.

    Parameters
    ----------
    given : str
        The file; with several cameras under other names, ``FILE:NAME``.
    camera : str
        Its name.

    Raises
    ------
    InputError
        As of `read_lenses`, or it is not in the file.
    """
    file, colon, name = given.rpartition(":")
    is_name = bool(colon) and not Path(given).exists()
    path, wanted = (Path(file), name) if is_name else (Path(given), camera)
    fields = read_lens_fields(path)
    found = fields_by_camera(fields, [wanted])
    if not found or (is_name and wanted not in fields):
        raise InputError(
            f"{path} has no lens of camera {wanted}: it has {', '.join(fields)}; name one of "
            f"them: {camera}={path}:{next(iter(fields))}"
        )
    return found[wanted]


def fields_by_camera(
    fields: Mapping[str, CameraInfoFields], cameras: Sequence[str]
) -> dict[str, CameraInfoFields]:
    """Return what a file has of given cameras; of all, if it has one lens under another name.

    Slashes and the like in a name may be underscores in the file, which cannot have them.

    Parameters
    ----------
    fields : mapping of str to CameraInfoFields
        As of `read_lens_fields`.
    cameras : sequence of str
    """
    plain = {_NOT_IN_NAMES.sub("_", name): info for name, info in fields.items()}
    names = {name: _NOT_IN_NAMES.sub("_", name) for name in cameras}
    found = {
        name: fields.get(name, plain.get(short))
        for name, short in names.items()
        if name in fields or short in plain
    }
    if not found and len(set(fields.values())) == 1:
        found = dict.fromkeys(cameras, next(iter(fields.values())))
    return {name: info for name, info in found.items() if info is not None}


def read_lens_fields(
    path: Path, *, image_size: tuple[int, int] | None = None
) -> dict[str, CameraInfoFields]:
    """Read the CameraInfo of every camera; parameters and errors are those of `read_lenses`."""
    if not path.is_dir():
        return _of_file(path, image_size)
    whole = next((path / name for name in _WHOLE if (path / name).is_file()), None)
    if whole is not None:
        return _of_file(whole, image_size)
    files = sorted(file for file in path.iterdir() if file.suffix.lower() in _ENDINGS)
    if not files:
        raise InputError(
            f"{path} has no lenses: expected a file a camera, CAM.yaml, or one of "
            f"{', '.join(_WHOLE)} (of COLMAP, save the model as text)"
        )
    found: dict[str, CameraInfoFields] = {}
    for file in files:
        content = _of_file(file, image_size)
        single = len(set(content.values())) == 1
        found |= {file.stem: next(iter(content.values()))} if single else content
    return found


def _of_file(path: Path, image_size: tuple[int, int] | None) -> dict[str, CameraInfoFields]:
    text = read_bounded(path, MAX_YAML_LENGTH)
    if is_colmap(text):
        return _without_p(colmap_lenses(path))
    lines = (line.strip() for line in text.splitlines())
    if _TOML.fullmatch(next((line for line in lines if line and line[0] != "#"), "")):
        return _without_p(toml_lenses(read_toml(path), str(path)))
    try:
        storage = OpencvStorage(path)
    except InputError as error:
        known = path.suffix.lower() in _ENDINGS
        raise InputError(f"{error if known else f'{path} has no lens'}; {_EXPECTED}") from None
    content = storage.content
    if "camera_matrix" in content and _CAMERA_INFO & content.keys():
        return dict([fields_of_content(content, path)])
    if is_camchain(content):
        return _without_p(camchain_lenses(content, str(path)))
    if str(content.get("format", "")).startswith("stcalib/"):
        return _without_p({c.name: c.intrinsics for c in read_result(path).cameras})
    if has_matrix(content):
        return _without_p(storage_lenses(storage, path, image_size))
    keys = ", ".join(map(str, list(content)[:_SHOWN])) or "nothing"
    raise InputError(f"{path} has no lens, but {keys[:MAX_QUOTED]}; {_EXPECTED}")


def _without_p(lenses: Mapping[str, Intrinsics]) -> dict[str, CameraInfoFields]:
    return {name: fields_of_lens(one)._replace(p=_NO_P) for name, one in lenses.items()}
