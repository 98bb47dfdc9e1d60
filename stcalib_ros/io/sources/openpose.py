"""OpenPose's JSON, one file for each image, as many other programs write it as well.

::

    SOURCE/CAMERA/video_000000000001_keypoints.json     folders or the begin of names tell cameras

``people`` have ``pose_keypoints_2d``: x, y, score of BODY_25, COCO or other joints. ``person_id``
is ``[-1]`` without tracking.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stcalib_ros.io.json_files import read_json
from stcalib_ros.io.sources.cameras import (
    NumberedFile,
    by_camera_and_image,
    head,
    looked_at,
    with_suffix,
)
from stcalib_ros.io.sources.form import (
    UNTRACKED,
    CameraPoses,
    Pose,
    PoseFormat,
    PoseSource,
    points_of,
    reading,
    whole_number,
)

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
    groups = by_camera_and_image(path, with_suffix(files, ".json"))
    return PoseSource(path, tuple(_camera(name, group) for name, group in groups.items()))


def _camera(name: str, files: Sequence[NumberedFile]) -> CameraPoses:
    poses = [pose for file in files for pose in _poses(Path(file.path), file.image)]
    stamps = [file.stamp_ns for file in files if file.stamp_ns is not None]
    return CameraPoses(
        name,
        np.array([file.image for file in files], dtype=np.int64),
        tuple(poses),
        np.array(stamps, dtype=np.int64) if len(stamps) == len(files) else None,
    )


def _poses(file: Path, image: int) -> list[Pose]:
    content = read_json(file)
    with reading(file, "a result of OpenPose"):
        found = [
            (_id(person), points_of(person["pose_keypoints_2d"])) for person in content["people"]
        ]
    return [Pose(image, track, points) for track, points in found if len(points)]


def _id(person: dict[str, Any]) -> int:
    """Id of a tracked person, which is a number in a list."""
    value = np.ravel(person.get("person_id", UNTRACKED))
    return UNTRACKED if not len(value) or value[0] == UNTRACKED else whole_number(value[0])


OPENPOSE = PoseFormat(
    "OpenPose's JSON, a file for each image",
    is_openpose,
    read_openpose,
)
