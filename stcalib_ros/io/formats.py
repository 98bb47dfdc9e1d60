"""Which of the formats that can be converted a file or folder has, by its content."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.datasets import DATASETS
from stcalib_ros.io.files import head
from stcalib_ros.io.npz_files import names_in_npz
from stcalib_ros.io.sources import SOURCES
from stcalib_ros.io.sources.cameras import files_below, looked_at

FORMATS = ("npz", *SOURCES, *DATASETS)
"""Names of all formats."""

_N_SHOWN = 4
"""Endings or keys of files that a message names, count: they fit on a line. Chosen."""

_N_BEGIN = 16
"""Bytes by which a file is known that is no text: that of SQLite, the longest mark."""

_PICTURES = {
    *(".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg"),
    *(".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff"),
}
_POSE_FILES = {".json", ".csv", ".txt", ".npz", ".npy"}
_BAGS = (b"\x89MCAP", b"SQLite format 3\0")
_PACKED = (b"PK", b"\x1f\x8b", b"7z", b"Rar!", b"\xfd7zXZ", b"(\xb5/\xfd")
_ARCHIVES = {".zip", ".gz", ".tgz", ".7z", ".rar", ".xz", ".zst"}
_KEY = re.compile(r'"(?:[^"\\]|\\.)*"(?=\s*:)')
"""Key in JSON, with its quotes."""
_NOBODY = re.compile(r"\[\s*\]\s*")


def _is_multi_view(path: Path) -> bool:
    return path.is_file() and bool({"camera_names", "det_kp2d"} & set(names_in_npz(path)))


_OTHERS: Mapping[str, Callable[[Path], bool]] = {
    "npz": _is_multi_view,
    "panoptic": lambda path: (path / "hdPose3d_stage1_coco19").is_dir(),
    "easymocap": lambda path: (path / "intri.yml").is_file() and (path / "extri.yml").is_file(),
    "mmptrack": lambda path: any(path.glob("rgb_*_*.json")),
}
"""How the formats are recognised that are not of `SOURCES`."""


def recognise(path: Path) -> str:
    """Return the name of the format that a file or folder has.

    Raises
    ------
    InputError
        It is not there, or has none of them; the message says what it looks like.
    """
    files = files_below(path)
    found = [name for name, source in SOURCES.items() if source.recognises(path, files)]
    found += [name for name, is_one in _OTHERS.items() if is_one(path)]
    if found:
        return found[0]
    mistake = _mistake(path, files)
    if mistake is not None:
        raise InputError(f"{path} {mistake.what}: {mistake.instead}")
    raise InputError(
        f"{path} is {_looks(path, files)}, and none of the formats that can be converted: "
        f"{', '.join(FORMATS)}. Name the one that it should be with --format, to read what it "
        "lacks; docs/formats.md shows what each looks like"
    )


class _Mistake(NamedTuple):
    """What is often given by mistake: what it is, and what to do instead."""

    what: str
    instead: str


def _mistake(path: Path, files: Sequence[Path]) -> _Mistake | None:
    """Return what a source is that holds no poses; None: who knows."""
    if not any(file.stat().st_size for file in files):
        empty = "has only empty files (0 bytes)" if files else "is an empty folder"
        return _Mistake(empty, "name the one to which the pose estimator wrote")
    counts = Counter(file.suffix.lower() for file in files)
    ending, _ = counts.most_common(1)[0]
    if ending in _PICTURES and not set(counts) & _POSE_FILES:
        return _Mistake(
            f"has pictures ({ending}) and no poses",
            "run a pose estimator on them, and name the folder of its results; docs/formats.md "
            "lists those that are read",
        )
    if ending == ".json" and all(_NOBODY.fullmatch(head(f)) for f in looked_at(files, ending)):
        return _Mistake(
            "has JSON files that are empty lists",
            "the pose estimator found nobody: check that it saw the people",
        )
    if arrays := [file.name for file in files if path.is_dir() and _is_multi_view(file)]:
        return _Mistake(
            "has files of multi-view arrays", f"name one: {', '.join(arrays[:_N_SHOWN])}"
        )
    if path.is_dir():
        packed = _Mistake(f"has packed files ({ending})", "unpack them first")
        return packed if ending in _ARCHIVES else None
    return _mistaken_file(path, ending)


def _mistaken_file(path: Path, ending: str) -> _Mistake | None:
    begin = _begin(path)
    if begin.startswith(_BAGS):
        return _Mistake(
            "is a bag already",
            f"`stcalib doctor {path}` says what is in it, and "
            f"`stcalib calibrate {path} --output OUT.yaml` calibrates",
        )
    if begin.startswith(_PACKED) and ending in _ARCHIVES:
        return _Mistake("is an archive", "unpack it, and name the folder")
    return None


def _begin(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return stream.read(_N_BEGIN)
    except OSError:
        return b""


def _looks(path: Path, files: Sequence[Path]) -> str:
    """Say what it looks like: the endings of the files, the keys of a JSON file, or its size."""
    if path.is_dir():
        counts = Counter(file.suffix.lower() or "without ending" for file in files)
        most = [f"{n} {ending}" for ending, n in counts.most_common(_N_SHOWN)]
        return f"a folder of {', '.join(most)}"
    if path.suffix.lower() == ".json" and (keys := _KEY.findall(head(path))):
        return f"a file .json that begins with {', '.join(keys[:_N_SHOWN])}"
    return f"a file {path.suffix or 'without ending'} of {path.stat().st_size} bytes"
