"""Which file is of which camera, and of which image: by folders and names."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path, PurePath
from typing import NamedTuple

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.files import head
from stcalib_ros.io.limits import MAX_SOURCE_FILES
from stcalib_ros.io.messages import NS
from stcalib_ros.io.topic_names import name_for_topics

_N_LOOKED_AT = 50
"""Files that are looked at to recognise a source, count: images at its begin may be without people.
Chosen."""
_MAX_CAMERAS = 256
"""Cameras, count. Names of images that begin in more ways are taken for something else, as dates.
Chosen: above the largest rigs."""
_NUMBER = re.compile(r"(.*?)(\d+)\D*")
_SECONDS = re.compile(r"(.*?)(?<!\d)(\d{10})[._-](\d{9}|\d{6}|\d{3})(?!\d)\D*")
"""A stamp of seconds and their fraction in the name of a file."""
_UNIX_DIGITS = {13: 6, 16: 3, 19: 0}
"""Digits of a Unix time in ms, us and ns, and the power of ten that makes it ns."""
_ADDED = re.compile(
    r"^((results|predictions|keypoints|poses?)[_.-])+"
    r"|([_.-](json|keypoints|openpose|alphapose|results|poses?|2d))+$",
    re.IGNORECASE,
)
"""What programs add to the name of a camera."""


class NumberedFile(NamedTuple):
    """A file of one image.

    `stamp_ns` is None where its name has a number, not a time.
    """

    path: PurePath
    image: int
    stamp_ns: int | None


def files_below(path: Path) -> tuple[Path, ...]:
    """All files of a source, in the order of their names, also behind symbolic links.

    Hidden ones, and what macOS adds to archives, are left out.

    Raises
    ------
    InputError
        It is not there, a folder or link of it leads nowhere, or it has more files than any
        recording.
    """
    if path.is_file():
        return (path,)
    if not path.is_dir():
        raise InputError(f"no such file or folder: {path}")
    found = []
    for file in _walk(path):
        found.append(file)
        if len(found) > MAX_SOURCE_FILES:
            raise InputError(f"{path} has more than {MAX_SOURCE_FILES} files: name a folder in it")
    return tuple(sorted(file for file in found if file.is_file()))


def _walk(path: Path) -> Iterator[Path]:
    for folder, inner, names in os.walk(path, followlinks=True, onerror=_refuse):
        inner[:] = [
            n for n in inner if not _left_out(n) and not _is_above(Path(folder, n), Path(folder))
        ]
        for file in (Path(folder, name) for name in names if not _left_out(name)):
            if file.is_symlink() and not file.exists():
                raise InputError(f"{file} is a link to {file.readlink()}, which is not there")
            yield file


def _refuse(error: OSError) -> None:
    raise InputError(f"cannot read the folder {error.filename}: {error.strerror}") from error


def _left_out(name: str) -> bool:
    return name.startswith(".") or name == "__MACOSX"


def _is_above(link: Path, folder: Path) -> bool:
    """Whether a symbolic link leads back to a folder that it is in."""
    return link.is_symlink() and folder.resolve().is_relative_to(link.resolve())


def with_suffix(files: Iterable[Path], suffix: str) -> list[Path]:
    """Return the files of one ending."""
    return [file for file in files if file.suffix.lower() == suffix]


def fitting_files(files: Sequence[Path], suffix: str, fits: Callable[[str], bool]) -> list[Path]:
    """Return the files of one ending whose begin fits; all of that ending, if that of none does.

    Raises
    ------
    InputError
        Some fit, and another is empty: a camera would be missing.
    """
    heads = {file: head(file) for file in with_suffix(files, suffix)}
    fitting = [file for file, text in heads.items() if fits(text)]
    if fitting and (empty := [file for file, text in heads.items() if not text]):
        raise InputError(f"{empty[0]} is empty: write it again, or remove it")
    return fitting or list(heads)


def looked_at(files: Sequence[Path], suffix: str) -> list[Path]:
    """Return some files of one ending, from all parts of the source, to recognise it by."""
    fitting = with_suffix(files, suffix)
    return fitting[:: max(len(fitting) // _N_LOOKED_AT, 1)]


def by_camera(root: Path, files: Sequence[Path]) -> dict[str, Path]:
    """Return files, each of a camera, by its name.

    Raises
    ------
    InputError
        Two would have the same name.
    """
    keys = [(*_folders(root, file), file.stem) for file in files]
    return dict(zip(_names(root, keys), files, strict=True))


def by_camera_and_image(
    root: Path, files: Sequence[PurePath]
) -> dict[str, tuple[NumberedFile, ...]]:
    """Return files, each of an image, by the name of the camera: its folder, or how names begin.

    Raises
    ------
    InputError
        A name has no number, or two files of a camera have the same.
    """
    groups: dict[tuple[str, ...], list[NumberedFile]] = {}
    for file in files:
        prefix, numbered = _numbered(file)
        groups.setdefault((*_folders(root, file), prefix), []).append(numbered)
    if len(groups) > _MAX_CAMERAS:
        raise InputError(
            f"{root}: file names begin in {len(groups)} different ways, too many to be cameras: "
            "put the files of each camera into a folder, named by image numbers"
        )
    names = _names(root, list(groups))
    return {n: _ordered(root, g) for n, g in zip(names, groups.values(), strict=True)}


def _folders(root: Path, file: PurePath) -> tuple[str, ...]:
    return file.relative_to(root if root.is_dir() else root.parent).parts[:-1]


def _numbered(file: PurePath) -> tuple[str, NumberedFile]:
    if timed := _SECONDS.fullmatch(file.stem):
        stamp = int(timed[2]) * NS + int(timed[3].ljust(9, "0"))
        return timed[1], NumberedFile(file, stamp, stamp)
    match = _NUMBER.fullmatch(file.stem)
    if match is None:
        raise InputError(
            f"{file}: its name has no number of an image, as in {file.stem}_000001{file.suffix}"
        )
    digits = match[2]
    power = None if digits.startswith("0") else _UNIX_DIGITS.get(len(digits))
    if power is None:
        return match[1], NumberedFile(file, int(digits), None)
    stamp = int(digits) * 10**power
    return match[1], NumberedFile(file, stamp, stamp)


def _ordered(root: Path, group: list[NumberedFile]) -> tuple[NumberedFile, ...]:
    group = sorted(group, key=lambda one: one.image)
    for one, other in pairwise(group):
        if one.image == other.image:
            raise InputError(f"{root}: {one.path} and {other.path} are of the same image")
    return tuple(group)


def _names(root: Path, keys: Sequence[tuple[str, ...]]) -> list[str]:
    """Return a name for each camera: by the part of its key in which all differ."""
    deepest = max((len(key) for key in keys), default=0)
    columns = list(zip(*[(*[""] * (deepest - len(key)), *key) for key in keys], strict=True))
    columns = [tuple(plain_name(part) for part in column) for column in columns]
    if len(keys) == 1:
        (*folders, prefix) = (part for (part,) in columns)
        above = plain_name(root.absolute().stem)
        return [next(filter(None, (*folders, above, prefix)), "cam0")]
    telling = [column for column in columns if len(set(column)) > 1] or columns
    alone = [column for column in telling if len(set(column)) == len(keys) and all(column)]
    names = (
        list(alone[0]) if alone else ["_".join(filter(None, p)) for p in zip(*telling, strict=True)]
    )
    _require_names(root, keys, names)
    return names


def _require_names(root: Path, keys: Sequence[tuple[str, ...]], names: Sequence[str]) -> None:
    made_of = "names of cameras are made of the letters a to z, digits and underscores"
    given = [Path(*key).as_posix() for key in keys]
    for k, name in enumerate(names):
        same = [own for own, other in zip(given, names, strict=True) if other == name]
        if not name:
            raise InputError(f"{root}: {given[k]} gives its camera no name: rename it; {made_of}")
        if len(same) > 1:
            raise InputError(
                f"{root}: {' and '.join(same[:2])} would both be called {name}: rename one; "
                f"{made_of}"
            )


def plain_name(text: str) -> str:
    """Return a camera's name as topics can have it, without what programs add to it."""
    return name_for_topics(_ADDED.sub("", text))


def natural_order(name: str) -> tuple[tuple[str, int], ...]:
    """Key by which cam2 comes before cam10."""
    return tuple((text, int(digits or 0)) for text, digits in re.findall(r"(\D*)(\d*)", name))
