"""JSON of MMPose and RTMPose (``--pred-out-dir``, ``--save-predictions``).

::

    SOURCE/CAMERA.json             {"meta_info": ..., "instance_info": [{"frame_id", "instances"}]},
                                   or that list alone, of a video
    SOURCE/CAMERA/000001.json      the instances of an image: keypoints, keypoint_scores
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from stcalib_ros.io.files import head
from stcalib_ros.io.json_files import read_json
from stcalib_ros.io.sources.cameras import fitting_files, looked_at
from stcalib_ros.io.sources.form import PoseFormat, PoseSource, reading, track_of, whole_number
from stcalib_ros.io.sources.images import PersonInImage, cameras_of_images

_OF_MMPOSE = re.compile(r'\{\s*"(meta_info|instance_info)"|\[.*"(keypoint_scores|instances)"', re.S)
_NOBODY = re.compile(r"\[\s*\]")
_FITTING = re.compile(f"{_OF_MMPOSE.pattern}|{_NOBODY.pattern}", re.S)


def is_mmpose(path: Path, files: Sequence[Path]) -> bool:
    """Whether JSON files begin as those of MMPose do."""
    del path
    return any(_OF_MMPOSE.match(head(file)) for file in looked_at(files, ".json"))


def read_mmpose(path: Path, files: Sequence[Path]) -> PoseSource:
    """Read the poses of all cameras.

    Raises
    ------
    InputError
        A file has another form.
    """
    numbered = [file for file in files if _is_image_or_video(file)]
    fitting = fitting_files(numbered, ".json", lambda text: bool(_FITTING.match(text)))
    found: dict[PurePath, list[PersonInImage]] = {}
    for file in fitting:
        content = read_json(file)
        with reading(file, "a result of MMPose"):
            found |= _images(file, content)
    return PoseSource(path, cameras_of_images(path, found, complete=True))


def _is_image_or_video(file: Path) -> bool:
    """Whether a file is about people: an empty list that is of no image may be anything."""
    return any(c.isdigit() for c in file.stem) or not _NOBODY.match(head(file))


def _images(file: Path, content: Any) -> dict[PurePath, list[PersonInImage]]:
    """People of the image, or of the images of a video, that a file is about."""
    listed = content["instance_info"] if isinstance(content, Mapping) else content
    if all("frame_id" not in item for item in listed):
        return {file: [_person(item) for item in listed]}
    return {
        file.with_suffix("") / str(whole_number(frame["frame_id"])): [
            _person(item) for item in frame["instances"]
        ]
        for frame in listed
    }


def _person(item: Mapping[str, Any]) -> PersonInImage:
    xy = np.asarray(item["keypoints"], dtype=np.float64)
    scores = np.asarray(item["keypoint_scores"], dtype=np.float64)
    if xy.shape != (len(scores), 2):
        raise ValueError(f"keypoints of shape {xy.shape} with {len(scores)} scores")
    return PersonInImage(track_of(item.get("track_id")), np.c_[xy, scores])


MMPOSE = PoseFormat(
    "JSON of MMPose or RTMPose: a file for each video or image", is_mmpose, read_mmpose
)
