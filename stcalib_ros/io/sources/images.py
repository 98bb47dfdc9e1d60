"""Cameras from people found in images that have a name, in whichever files they are written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import NamedTuple

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.io.limits import MAX_TABLE
from stcalib_ros.io.sources.cameras import NumberedFile, by_camera_and_image
from stcalib_ros.io.sources.form import CameraPoses, Pose


class PersonInImage(NamedTuple):
    """One person in one image: the id of a tracker or `UNTRACKED`, and points (J, 3)."""

    track: int
    points: Float64Array


def cameras_of_images(
    root: Path,
    found: Mapping[PurePath, Sequence[PersonInImage]],
    *,
    complete: bool,
    sizes: Mapping[PurePath, tuple[int, int]] | None = None,
) -> tuple[CameraPoses, ...]:
    """Cameras from people by the names of the images, which name the camera, too.

    Parameters
    ----------
    root : Path
        The source.
    found : mapping of PurePath to sequence of PersonInImage
        By the path of the image, or of the file that is about it.
    complete : bool
        All images are there, also those without people; else numbers that are missing are images
        in which nobody was found.
    sizes : mapping of PurePath to (int, int), optional
        Width and height of images, px.

    Raises
    ------
    InputError
        A name has no number, or images of a camera differ in size.
    """
    groups = by_camera_and_image(root, list(found))
    return tuple(
        CameraPoses(
            name,
            _numbers(root, group, found, complete),
            tuple(Pose(file.image, *one) for file in group for one in found[file.path]),
            _stamps(group),
            _size(root, name, group, sizes or {}),
        )
        for name, group in groups.items()
    )


def _numbers(
    root: Path,
    group: Sequence[NumberedFile],
    found: Mapping[PurePath, Sequence[PersonInImage]],
    complete: bool,
) -> IntArray:
    if complete or _stamps(group) is not None:
        return np.array([file.image for file in group], dtype=np.int64)
    return all_images([file.image for file in group if found[file.path]], root)


def _stamps(group: Sequence[NumberedFile]) -> IntArray | None:
    stamps = [file.stamp_ns for file in group if file.stamp_ns is not None]
    return np.array(stamps, dtype=np.int64) if len(stamps) == len(group) else None


def _size(
    root: Path,
    name: str,
    group: Sequence[NumberedFile],
    sizes: Mapping[PurePath, tuple[int, int]],
) -> tuple[int, int] | None:
    known = sorted({sizes[file.path] for file in group if file.path in sizes})
    if len(known) > 1:
        raise InputError(
            f"{root}: images of {name} have {' and '.join(f'{w} x {h}' for w, h in known)} px: "
            "those of a camera have one size"
        )
    return known[0] if known else None


def all_images(numbers: Sequence[int], path: Path) -> IntArray:
    """Numbers of all images from the first to the last one of those in which somebody was found.

    Where only every n-th image was looked at, it is every n-th.

    Raises
    ------
    InputError
        There are none, or more than a recording has.
    """
    known = np.unique(np.array(numbers, dtype=np.int64))
    if not len(known):
        raise InputError(f"{path} has no poses")
    step = int(np.gcd.reduce(np.diff(known))) if len(known) > 1 else 1
    if (n := (int(known[-1]) - int(known[0])) // step) > MAX_TABLE:
        raise InputError(
            f"{path}: images are numbered {known[0]} to {known[-1]}: {n} images are too many"
        )
    return np.arange(int(known[0]), int(known[-1]) + 1, step)
