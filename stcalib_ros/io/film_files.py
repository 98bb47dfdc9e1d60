"""Which films there are, of which cameras, and whether they are still the same."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.sources.cameras import by_camera, files_below, natural_order
from stcalib_ros.io.sources.videos import VIDEO_ENDINGS

FILM_ENDINGS = (*VIDEO_ENDINGS, ".mpg", ".mts", ".ts", ".3gp", ".wmv")
"""Endings of the names of films, in small letters."""
_SAMPLE_BYTES = 1 << 20
"""Bytes. Of a film, as many are compared at its begin, middle and end, and its size: all of it
would take seconds per GB. Chosen."""


def is_film(path: Path) -> bool:
    """Whether a path is a film by its name, or a folder with films in it and no bag."""
    if not path.is_dir():
        return path.suffix.lower() in FILM_ENDINGS or ":/" in str(path)
    names = [entry.name for entry in path.iterdir()]
    is_bag = any(name == "metadata.yaml" or name.endswith((".mcap", ".db3")) for name in names)
    return not is_bag and any(Path(name).suffix.lower() in FILM_ENDINGS for name in names)


def films_by_camera(given: Sequence[tuple[str, Path]]) -> dict[str, Path]:
    """Return the films by the names of their cameras, cam2 before cam10.

    Parameters
    ----------
    given : sequence of (str, Path)
        Name of the camera and its film. Without a name: the film of a camera that is called as
        `stcalib convert` does it, by its file or its folder; or a folder with a film a camera.

    Raises
    ------
    InputError
        There is none, only one, or one twice; or two have the same name.
    """
    named = {name: path for name, path in given if name}
    if len(named) < sum(1 for name, _ in given if name):
        raise InputError(f"a camera has two films: {', '.join(f'{n}={p}' for n, p in given if n)}")
    paths = [path for name, path in given if not name]
    if address := next((path for _, path in given if ":/" in str(path)), None):
        raise InputError(
            f"{address} is an address: record films first, or use the node pose_estimator for "
            "cameras that are running"
        )
    if numbered := next((path for _, path in given if "%" in path.name), None):
        raise InputError(
            f"{numbered} is a pattern of images: make a film of them, "
            f"ffmpeg -framerate HZ -i {numbered} CAMERA.mp4"
        )
    files = [file.absolute() for path in paths for file in _films_of(path)]
    if twice := sorted({str(file) for file in files if files.count(file) > 1}):
        raise InputError(f"{twice[0]} is given twice: one film of each camera")
    found = named | (by_camera(_common_folder(files), files) if files else {})
    if len(found) < len(named) + len(files):
        raise InputError("two films of one camera: name them, as in cam0=left.mp4 cam1=right.mp4")
    if len(found) < 2:
        only = ", ".join(map(str, found.values())) or "none"
        raise InputError(f"films of two cameras or more are needed, got {only}: name all of them")
    return dict(sorted(found.items(), key=lambda item: natural_order(item[0])))


def film_id(path: Path) -> str:
    """Return a short text that differs for films of different content.

    Raises
    ------
    InputError
        The film cannot be read.
    """
    try:
        size = path.stat().st_size
        digest = hashlib.sha256(str(size).encode())
        with path.open("rb") as stream:
            for at in (0, size // 2, max(size - _SAMPLE_BYTES, 0)):
                stream.seek(at)
                digest.update(stream.read(_SAMPLE_BYTES))
    except OSError as error:
        raise InputError(f"cannot read the film {path}: {error.strerror}") from error
    return digest.hexdigest()[:32]


def _films_of(path: Path) -> Iterable[Path]:
    if not path.is_dir():
        return (path,)
    films = [file for file in files_below(path) if file.suffix.lower() in FILM_ENDINGS]
    if not films:
        raise InputError(
            f"{path} has no films: their names end in {', '.join(FILM_ENDINGS)}; of images, make a "
            "film of each camera first"
        )
    return films


def _common_folder(files: Sequence[Path]) -> Path:
    return Path(os.path.commonpath([file.parent for file in files]))
