"""Which of the formats that can be converted a file or folder has, by its content."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.datasets import DATASETS
from stcalib_ros.io.npz_files import names_in_npz
from stcalib_ros.io.sources import SOURCES
from stcalib_ros.io.sources.cameras import files_below

FORMATS = ("npz", *SOURCES, *DATASETS)
"""Names of all formats."""

_N_ENDINGS = 4
"""Endings of files that a message names, count: those of which there are most. Chosen."""


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
    if not found:
        raise InputError(
            f"{path} is {_looks(path, files)}, and none of the formats that can be converted: "
            f"{', '.join(FORMATS)}. Name the one that it should be with --format, to read what it "
            "lacks; docs/formats.md shows what each looks like"
        )
    return found[0]


def _looks(path: Path, files: Sequence[Path]) -> str:
    """Say what it looks like: the endings of the files, or how a file begins."""
    if path.is_dir():
        counts = Counter(file.suffix.lower() or "without ending" for file in files)
        most = [f"{n} {ending}" for ending, n in counts.most_common(_N_ENDINGS)]
        return f"a folder of {', '.join(most)}" if most else "an empty folder"
    return f"a file {path.suffix or 'without ending'} of {path.stat().st_size} bytes"
