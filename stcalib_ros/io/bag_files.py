"""The files of a bag: those that its metadata lists, or those that are there."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from pathlib import Path

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.yaml_files import read_yaml

_METADATA = "metadata.yaml"
_INFO = "rosbag2_bagfile_information"
_SUFFIXES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
_MOST_NAMES = 5
"""File names that a message lists."""


def bag_files(path: Path, *, warn: Callable[[str], None] | None = None) -> tuple[Path, ...]:
    """Files of a bag, in order: the file itself, or those of a rosbag2 folder.

    The metadata gives the order. Without them, or where they list files that are not there, as
    after renaming, the folder does. Empty files, as a killed recorder leaves them, are left out.

    Parameters
    ----------
    path : Path
    warn : callable, optional
        Called with a line for everything of that kind. Default: the logger of the module.

    Raises
    ------
    InputError
        There is no such bag, or it has no content.
    """
    warn = warn or logging.getLogger(__name__).warning
    if not path.exists():
        raise InputError(f"no such bag: {path}")
    if path.is_file():
        return (path,)
    if not path.is_dir():
        raise InputError(f"{path} is neither a file nor a folder: name a bag")
    there = sorted(
        (p for p in path.iterdir() if p.name.endswith(_SUFFIXES) and p.is_file()),
        key=lambda p: (len(p.name), p.name),
    )
    files = _listed_files(path, there, warn)
    if not files:
        raise InputError(f"{path} {_what_else(path)}")
    empty = [f for f in files if not f.stat().st_size]
    if len(empty) == len(files):
        raise InputError(
            f"{path}: all {len(files)} files are empty (0 bytes): nothing was recorded"
        )
    if empty:
        warn(
            f"{path}: {len(empty)} of {len(files)} files are empty (0 bytes) and left out: "
            f"{_names(empty)}"
        )
    return tuple(f for f in files if f not in empty)


def _what_else(folder: Path) -> str:
    """Say what a folder is that has no files of a bag, and what to do."""
    there = sorted(folder.iterdir())
    if bags := [path for path in there if path.is_dir() and is_bag_folder(path)]:
        return (
            f"is a folder of {len(bags)} bags: name one of {_names(bags)}; if they are of "
            "different cameras at the same time, put the files of all into one folder"
        )
    return (
        f"is not a bag: it has no {', '.join(_SUFFIXES)} files, but {_names(there) or 'nothing'}; "
        "`stcalib convert` makes a bag of poses in the files of other programs"
    )


def is_bag_folder(path: Path) -> bool:
    """Whether there are files of a bag in a folder, or its metadata."""
    return (path / _METADATA).exists() or any(p.name.endswith(_SUFFIXES) for p in path.iterdir())


def _listed_files(
    folder: Path, there: Sequence[Path], warn: Callable[[str], None]
) -> Sequence[Path]:
    """Files that the metadata lists, if all are there; else those that are there."""
    metadata = folder / _METADATA
    if not metadata.exists():
        return there
    try:
        names = _file_names(metadata)
    except InputError as error:
        if not there:
            raise
        warn(f"{error}; the {len(there)} bag files of the folder are read")
        return there
    # Old releases list them with the folder; they are always in it.
    listed = [folder / Path(name).name for name in names]
    missing = [f for f in listed if not f.is_file()]
    if not missing:
        return listed
    if not there:
        raise InputError(
            f"{metadata} lists files that are missing: {_names(missing)}; there are no others"
        )
    warn(
        f"{metadata} lists {len(missing)} files that are missing: {_names(missing)}; the others "
        f"are read: {_names(there)}"
    )
    return there


def _names(files: Sequence[Path]) -> str:
    more = "" if len(files) <= _MOST_NAMES else ", ..."
    return ", ".join(f.name for f in files[:_MOST_NAMES]) + more


def _file_names(metadata: Path) -> list[str]:
    content = read_yaml(metadata)
    info = content.get(_INFO) if isinstance(content, dict) else None
    if not isinstance(info, dict):
        raise InputError(f"{metadata} is not rosbag2 metadata: it has no {_INFO}")
    names = info.get("relative_file_paths")
    if not isinstance(names, list) or not names:
        raise InputError(f"{metadata}: relative_file_paths lists no file")
    return list(dict.fromkeys(str(name) for name in names))
