"""Labels of Ultralytics' YOLO pose models (``save_txt=True``), one file for each image with people.

::

    SOURCE/CAMERA/labels/walk_1.txt     class x y w h, then x y score of each keypoint, then the
                                        confidence (save_conf) and the id (of tracking), if any

Positions are 0 to 1 across the image.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path, PurePath

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.io.files import head, read_bounded
from stcalib_ros.io.limits import MAX_LABELS_BYTES
from stcalib_ros.io.sources.cameras import looked_at, with_suffix
from stcalib_ros.io.sources.form import (
    UNTRACKED,
    PoseFormat,
    PoseSource,
    reading,
    whole_number,
)
from stcalib_ros.io.sources.images import PersonInImage, cameras_of_images

_BOX = 5
"""Numbers before the keypoints of a line, count: class and box. Definition of the format."""
_MIN_COLUMNS = _BOX + 3 * 5
"""Numbers of a line, count, from which on it can be a pose: with fewer than five keypoints it is
none of a person. Chosen."""


def is_ultralytics(path: Path, files: Sequence[Path]) -> bool:
    """Whether text files have lines of numbers, as many as a pose has."""
    del path
    return any(_is_label(head(file)) for file in looked_at(files, ".txt"))


def _is_label(text: str) -> bool:
    first = text.partition("\n")[0].split()
    try:
        numbers = [float(word) for word in first]
    except ValueError:
        return False
    return len(numbers) >= _MIN_COLUMNS and all(0 <= n <= 1 for n in numbers[1:_BOX])


def read_ultralytics(path: Path, files: Sequence[Path]) -> PoseSource:
    """Read the poses of all cameras.

    Raises
    ------
    InputError
        A file has another form, or its name no number.
    """
    texts = with_suffix(files, ".txt")
    fitting = [file for file in texts if _is_label(head(file))]
    lines = {file: _lines(file) for file in fitting or texts}
    with_id = _have_ids(path, [line for of_image in lines.values() for line in of_image])
    found: dict[PurePath, list[PersonInImage]]
    found = {file: [_person(line, with_id) for line in lines[file]] for file in lines}
    cameras = cameras_of_images(path, found, complete=False)
    return PoseSource(path, cameras, normalised=True)


def _lines(file: Path) -> list[Float64Array]:
    with reading(file, "a file of Ultralytics' pose labels"):
        text = read_bounded(file, MAX_LABELS_BYTES)
        rows = [
            np.array(line.split(), dtype=np.float64) for line in text.splitlines() if line.strip()
        ]
    if wrong := [len(row) for row in rows if len(row) < _MIN_COLUMNS]:
        raise InputError(
            f"{file} is not a file of Ultralytics' pose labels: a line has {wrong[0]} numbers, "
            "fewer than class, box and keypoints: labels of boxes alone are no poses"
        )
    return rows


def _have_ids(path: Path, lines: Sequence[Float64Array]) -> bool:
    """Whether the last number is an id: it is whole, where a confidence is not."""
    extra = {(len(line) - _BOX) % 3 for line in lines}
    if len(extra) > 1:
        raise InputError(f"{path}: some lines have ids or confidences, and others have none")
    return extra == {2} or (extra == {1} and all(line[-1].is_integer() for line in lines))


def _person(line: Float64Array, with_id: bool) -> PersonInImage:
    n_joints = (len(line) - _BOX) // 3
    points = line[_BOX : _BOX + 3 * n_joints].reshape(n_joints, 3)
    return PersonInImage(whole_number(line[-1]) if with_id else UNTRACKED, points)


ULTRALYTICS = PoseFormat(
    "labels of Ultralytics' YOLO pose models (.txt, a file for each image)",
    is_ultralytics,
    read_ultralytics,
)
