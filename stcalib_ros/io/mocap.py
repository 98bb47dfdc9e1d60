"""The motion capture clips that come with the package."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import stcalib_ros
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.synthetic import MotionClip
from stcalib_ros.io.json_files import MALFORMED
from stcalib_ros.io.npz_files import read_npz

_LOCOMOTION = ("walk", "run")
_NOT_CYCLIC = ("getup", "cartwheel")


def shipped_clips() -> tuple[MotionClip, ...]:
    """Read the clips of the package that can be repeated, by name.

    Raises
    ------
    InputError
        The installation lacks them.
    """
    folders = [Path(p) / "data" / "mocap" for p in stcalib_ros.__path__]
    paths = sorted(p for folder in folders for p in folder.glob("*.npz"))
    clips = {p.stem: p for p in paths if not any(word in p.stem for word in _NOT_CYCLIC)}
    if not clips:
        raise InputError(f"no motion capture clips in {', '.join(map(str, folders))}")
    return tuple(read_clip(path) for path in clips.values())


def read_clip(path: Path) -> MotionClip:
    """Read a clip of an npz file with the arrays `pose17` (F, 17, 3) and `fps`.

    Raises
    ------
    InputError
        The file cannot be read or lacks an array.
    """
    try:
        arrays = read_npz(path)
        joints, fps = np.asarray(arrays["pose17"], dtype=float), float(arrays["fps"])
    except (*MALFORMED, InputError) as error:
        raise InputError(f"{path}: not a motion clip: {error}") from error
    return MotionClip(path.stem, fps, joints, any(word in path.stem for word in _LOCOMOTION))
