"""Lenses from the files of any program, recognised by their content."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.io.camera_info_yaml import fields_of_content
from stcalib_ros.io.datasets.opencv_storage import OpencvStorage
from stcalib_ros.io.files import head, read_bounded
from stcalib_ros.io.lens_formats.arrays import array_lenses
from stcalib_ros.io.lens_formats.colmap import colmap_lenses, is_colmap
from stcalib_ros.io.lens_formats.kalibr import camchain_lenses, is_camchain
from stcalib_ros.io.lens_formats.opencv import has_matrix, matrix_lenses
from stcalib_ros.io.lens_formats.toml import toml_lenses
from stcalib_ros.io.limits import MAX_QUOTED, MAX_YAML_LENGTH
from stcalib_ros.io.messages import CameraInfoFields, fields_of_lens, lens
from stcalib_ros.io.results import read_result
from stcalib_ros.io.toml_files import read_toml
from stcalib_ros.io.topic_names import name_for_topics

LENS_FORMATS = (
    "camera_info YAML",
    "a Kalibr camchain",
    "OpenCV's matrices (YAML, XML, JSON, npz)",
    "aniposelib, Pose2Sim or Caliscope TOML",
    "COLMAP's cameras.txt",
    "a result of stcalib",
)
"""What is recognised, in words."""
_EXPECTED = f"lenses are read from {', '.join(LENS_FORMATS[:-1])} or {LENS_FORMATS[-1]}"

_ENDINGS = (".yaml", ".yml", ".xml", ".toml", ".txt", ".json", ".npz")
_WHOLE = ("cameras.txt", "camera_array.toml", "intri.yml")
"""Files that have all cameras of the folder that they are in."""
_CAMERA_INFO = {"distortion_model", "rectification_matrix", "projection_matrix", "camera_name"}
_TOML = re.compile(r"\[[^\[\],]+\]|[\w.-]+\s*=.*")
"""First line of a TOML file that is no comment: a table or a value."""
_NO_P = (0.0,) * 12
"""P of a file that knows no rectified image: nothing is guessed for rectified keypoints."""
_OST_TEXT = re.compile(r"^\[image\]\s+width\s+\d+", re.MULTILINE)
"""Begin of what camera_calibration saves as ``ost.txt``."""
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
            f"{path} has no lens of {', '.join(missing)}: it has {', '.join(fields)}; add those "
            "that are missing, or rename them there as the cameras are called"
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

    Names are compared as topics can have them: slashes and the like are underscores.

    Parameters
    ----------
    fields : mapping of str to CameraInfoFields
        As of `read_lens_fields`.
    cameras : sequence of str
    """
    plain = {name_for_topics(name): info for name, info in fields.items()}
    names = {name: name_for_topics(name) for name in cameras}
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
    files = _lens_files(path)
    named = {file: file.stem for file in files}
    if not files:
        folders = [folder for folder in sorted(path.iterdir()) if folder.is_dir()]
        named = {file: folder.name for folder in folders for file in _lens_files(folder)}
    if not named:
        raise InputError(
            f"{path} has no lenses: expected a file a camera, CAM.yaml or CAM/ost.yaml, or one of "
            f"{', '.join(_WHOLE)} (of COLMAP, save the model as text)"
        )
    found: dict[str, CameraInfoFields] = {}
    for file, name in named.items():
        content = _of_file(file, image_size)
        single = len(set(content.values())) == 1
        found |= {name: next(iter(content.values()))} if single else content
    return found


def _lens_files(folder: Path) -> list[Path]:
    """Return files that may have lenses; text is notes or a log, but for that of COLMAP."""
    files = [file for file in sorted(folder.iterdir()) if not file.name.startswith(".")]
    fitting = [file for file in files if file.suffix.lower() in _ENDINGS]
    return [file for file in fitting if file.suffix.lower() != ".txt" or is_colmap(head(file))]


def _of_file(path: Path, image_size: tuple[int, int] | None) -> dict[str, CameraInfoFields]:
    if path.suffix.lower() == ".npz":
        return _without_p(array_lenses(path, image_size))
    return _of_text(path, _text(path), image_size)


def _of_text(
    path: Path, text: str, image_size: tuple[int, int] | None
) -> dict[str, CameraInfoFields]:
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
        return _without_p(matrix_lenses(content, path, image_size))
    keys = ", ".join(map(str, list(content)[:_SHOWN])) or "nothing"
    raise InputError(f"{path} has no lens, but {keys[:MAX_QUOTED]}; {_EXPECTED}")


def _text(path: Path) -> str:
    if path.suffix.lower() in (".gz", ".tgz", ".zip"):
        raise InputError(f"{path} is an archive: unpack it, and name the file of lenses in it")
    text = read_bounded(path, MAX_YAML_LENGTH)
    if not text.strip():
        raise InputError(f"{path} is empty: write it again, or name another file of lenses")
    if _OST_TEXT.search(text):
        raise InputError(f"{path} has lenses as text: name the ost.yaml that was saved beside it")
    return text


def _without_p(lenses: Mapping[str, Intrinsics]) -> dict[str, CameraInfoFields]:
    return {name: fields_of_lens(one)._replace(p=_NO_P) for name, one in lenses.items()}
