"""OpenPose's JSON, one file for each image, as many other programs write it as well.

::

    SOURCE/CAMERA/video_000000000001_keypoints.json     folders or the begin of names tell cameras

``people`` have ``pose_keypoints_2d``: x, y, score of BODY_25, COCO or other joints. ``person_id``
is ``[-1]`` without tracking. With ``--keypoint_scale`` 3 or 4, x and y are 0 to 1 or -1 to 1 across
the image, and what was not found is the corner with a score of 0.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path, PurePath
from typing import NamedTuple

import numpy as np

from stcalib_ros.io.files import head
from stcalib_ros.io.json_files import read_json
from stcalib_ros.io.sources.cameras import looked_at, with_suffix
from stcalib_ros.io.sources.form import PoseFormat, PoseSource, points_of, reading, track_of
from stcalib_ros.io.sources.images import PersonInImage, cameras_of_images

_EMPTY = re.compile(r'"people"\s*:\s*\[\s*\]')


def is_openpose(path: Path, files: Sequence[Path]) -> bool:
    """Whether JSON files begin as those of OpenPose do."""
    del path
    heads = (head(file) for file in looked_at(files, ".json"))
    return any(
        text.startswith("{") and '"people"' in text and bool("_2d" in text or _EMPTY.search(text))
        for text in heads
    )


def read_openpose(path: Path, files: Sequence[Path]) -> PoseSource:
    """Read the poses of all cameras.

    Raises
    ------
    InputError
        A file has another form, or its name no number.
    """
    found: dict[PurePath, list[PersonInImage]]
    found = {file: _people(file) for file in with_suffix(files, ".json") if not _is_other(file)}
    scaled = _in_pixels_or_fractions(found)
    return PoseSource(
        path, cameras_of_images(path, scaled.found, complete=True), normalised=scaled.normalised
    )


class _Scaled(NamedTuple):
    found: dict[PurePath, list[PersonInImage]]
    normalised: bool


def _in_pixels_or_fractions(found: dict[PurePath, list[PersonInImage]]) -> _Scaled:
    """Return people in pixels as they are, and those in fractions of the image from 0 to 1."""
    points = [person.points for people in found.values() for person in people]
    known = [one[one[:, 2] > 0, :2] for one in points]
    xy = np.concatenate(known) if known else np.zeros((0, 2))
    if not xy.any() or np.abs(xy).max() > 1:
        return _Scaled(found, normalised=False)
    first, side = (-1.0, 2.0) if xy.min() < 0 else (0.0, 1.0)
    return _Scaled(
        {file: [_fractions(one, first, side) for one in people] for file, people in found.items()},
        normalised=True,
    )


def _fractions(person: PersonInImage, first: float, side: float) -> PersonInImage:
    points = np.where(person.points[:, 2:] > 0, person.points, 0.0)
    points[:, :2] = np.where(points[:, 2:] > 0, (points[:, :2] - first) / side, 0.0)
    return person._replace(points=points)


def _is_other(file: Path) -> bool:
    """Whether a JSON file is about something else: no image by its name, no people in it."""
    return not any(c.isdigit() for c in file.stem) and '"people"' not in head(file)


def _people(file: Path) -> list[PersonInImage]:
    content = read_json(file)
    with reading(file, "a result of OpenPose"):
        people = [
            PersonInImage(track_of(person.get("person_id")), points_of(person["pose_keypoints_2d"]))
            for person in content["people"]
        ]
    return [person for person in people if len(person.points)]


OPENPOSE = PoseFormat("OpenPose's JSON, a file for each image", is_openpose, read_openpose)
