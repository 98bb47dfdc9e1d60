"""Common form of what pose estimators write: 2D poses, image by image, of each camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.io.json_files import MALFORMED
from stcalib_ros.io.limits import MAX_COUNT

UNTRACKED = -1
"""No unit. Id of a pose that no tracker follows. Chosen: ids of trackers are 0 or more."""


class Pose(NamedTuple):
    """One person in one image.

    `points` are (J, 3): x, y in px and score; x = y = 0 or NaN where nothing was found.
    """

    image: int
    track: int
    points: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class CameraPoses:
    """What was found in the images of one camera.

    Attributes
    ----------
    name : str
    images : (F,) ndarray of int
        Numbers of all images, increasing, also of those without anybody.
    poses : tuple of Pose
        In any order; `Pose.image` is one of `images`.
    stamps_ns : (F,) ndarray of int or None
        When each image was taken, Unix nanoseconds; None: by its number and the frame rate.
    size : (int, int) or None
        Width and height of the image, px, if the source says so.
    lens : Intrinsics or None
        If the source has it.
    fps : float or None
        Frame rate by the source.
    no_lens : str
        Why there is no lens of this camera in the file that has those of the others; empty: the
        source has no such file.
    """

    name: str
    images: IntArray
    poses: tuple[Pose, ...]
    stamps_ns: IntArray | None = None
    size: tuple[int, int] | None = None
    lens: Intrinsics | None = None
    fps: float | None = None
    no_lens: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class PoseSource:
    """What was found in all cameras.

    Attributes
    ----------
    path : Path
    cameras : tuple of CameraPoses
    layout : str
        Name of the layout by the source; empty: by the number of keypoints.
    normalised : bool
        Keypoints are 0 to 1 across the image, not px.
    """

    path: Path
    cameras: tuple[CameraPoses, ...]
    layout: str = ""
    normalised: bool = False


@dataclass(frozen=True, slots=True)
class SourceOptions:
    """What is said of a source beside its files.

    Attributes
    ----------
    image_size : (int, int) or None
        Width and height of the images of all cameras, px, where the source does not say.
    lenses : mapping of str to Intrinsics
        By the name of the camera; they take precedence over those of the source.
    """

    image_size: tuple[int, int] | None = None
    lenses: Mapping[str, Intrinsics] = field(default_factory=dict)


class PoseFormat(NamedTuple):
    """A form of files that can be read.

    Attributes
    ----------
    what : str
        Names the files, for messages.
    recognises : callable
        Whether these are such files: the source and all files in it.
    read : callable
        The poses in them; raises `InputError`.
    """

    what: str
    recognises: Callable[[Path, Sequence[Path]], bool]
    read: Callable[[Path, Sequence[Path]], PoseSource]


@contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """Say which file is malformed, and what it should be.

    Raises
    ------
    InputError
        The block met content of another form.
    """
    try:
        yield
    except MALFORMED as error:
        raise InputError(f"{path} is not {what} ({type(error).__name__}: {error})") from error


def points_of(flat: ArrayLike) -> Float64Array:
    """Keypoints (J, 3) from a flat list of x, y, score; a ValueError if it is none."""
    return np.asarray(flat, dtype=np.float64).reshape(-1, 3)


def track_of(value: object) -> int:
    """Return the id of a person, which may be in a list; none or -1 is `UNTRACKED`."""
    first = next(iter(value), None) if isinstance(value, list) else value
    untracked = first in (None, "") or float(first) == UNTRACKED  # type: ignore[arg-type]
    return UNTRACKED if untracked else whole_number(first)


def whole_number(value: object) -> int:
    """Return a number of an image or person; a ValueError or TypeError if it is none."""
    number = float(value)  # type: ignore[arg-type]
    if not (number.is_integer() and 0 <= number <= MAX_COUNT):
        raise ValueError(f"{value} is no number of an image or person")
    return int(number)
