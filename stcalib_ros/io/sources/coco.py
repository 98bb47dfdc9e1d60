"""COCO's JSON of keypoints, as data sets and as the results of detectors; AlphaPose's is one.

::

    SOURCE/CAMERA/alphapose-results.json     [{"image_id": "0.jpg", "keypoints": [x, y, score, ...],
                                               "idx": 1, "box": ..., ...}, ...]
                                             with --format open, cmu: {"0.jpg": {"people": [
                                               {"pose_keypoints_2d"}]}, "bodies", "joints" for cmu
    SOURCE/CAMERA.json                       the same of another program, or
                                             {"images": [{"id", "file_name", "width", "height"}],
                                              "annotations": [{"image_id", "keypoints"}]}

The names of images may have the camera, too: ``cam0/000001.jpg``. Ids are ``idx`` of AlphaPose's
tracking, or ``track_id``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

from stcalib_ros.io.files import head
from stcalib_ros.io.json_files import read_json
from stcalib_ros.io.sources.cameras import fitting_files, looked_at
from stcalib_ros.io.sources.form import PoseFormat, PoseSource, points_of, reading, track_of
from stcalib_ros.io.sources.images import PersonInImage, cameras_of_images

_ALPHAPOSE_FILE = "alphapose-results.json"
_LIST = re.compile(r"\[\s*\{")
_OF_ALPHAPOSE = re.compile(r'"(idx|box)"')
_BY_IMAGE = re.compile(r'\{\s*"[^"]*"\s*:\s*\{\s*"version"\s*:\s*"AlphaPose')
_WHOLE = re.compile(r'\{.*"(images|annotations)"\s*:\s*\[', re.DOTALL)


def _is_list(text: str) -> bool:
    return bool(_LIST.match(text)) and '"image_id"' in text and '"keypoints"' in text


def _is_alphapose(text: str) -> bool:
    of_list = _is_list(text) and bool(_OF_ALPHAPOSE.search(text))
    return of_list or bool(_BY_IMAGE.match(text))


def _is_coco(text: str) -> bool:
    return _is_list(text) or bool(_WHOLE.match(text) or _BY_IMAGE.match(text))


def is_alphapose(path: Path, files: Sequence[Path]) -> bool:
    """Whether JSON files begin as those of AlphaPose do."""
    del path
    return any(_is_alphapose(head(file)) for file in looked_at(files, ".json"))


def is_coco(path: Path, files: Sequence[Path]) -> bool:
    """Whether JSON files begin as those of COCO do."""
    del path
    return any(_is_coco(head(file)) for file in looked_at(files, ".json"))


def read_coco(path: Path, files: Sequence[Path]) -> PoseSource:
    """Read the poses of all cameras.

    Raises
    ------
    InputError
        A file has another form.
    """
    named = [file for file in files if file.name == _ALPHAPOSE_FILE]
    found: dict[PurePath, list[PersonInImage]] = {}
    sizes: dict[PurePath, tuple[int, int]] = {}
    complete = True
    for file in named or fitting_files(files, ".json", _is_coco):
        content = read_json(file)
        with reading(file, "a list of COCO keypoints"):
            if isinstance(content, Mapping) and _BY_IMAGE.match(head(file)):
                found |= _by_image(file, content)
                complete = False
            elif isinstance(content, Mapping):
                names = _image_names(file, content, sizes)
                found |= {name: [] for name in names.values()}
                _add(found, content["annotations"], names)
            else:
                names = {item["image_id"]: _path(file, item["image_id"]) for item in content}
                _add(found, content, names)
                complete = False
    return PoseSource(path, cameras_of_images(path, found, complete=complete, sizes=sizes))


def _path(file: Path, image: object) -> PurePath:
    return file.with_suffix("") / str(image).replace("\\", "/").lstrip("/")


def _by_image(
    file: Path, content: Mapping[str, Mapping[str, Any]]
) -> dict[PurePath, list[PersonInImage]]:
    """People of AlphaPose's ``--format open`` and ``cmu``."""
    return {
        _path(file, image): [
            PersonInImage(track_of(one.get("idx")), points_of(one[flat])) for one in found[people]
        ]
        for image, found in content.items()
        for people, flat in (("people", "pose_keypoints_2d"), ("bodies", "joints"))
        if people in found
    }


def _image_names(
    file: Path, content: Mapping[str, Any], sizes: dict[PurePath, tuple[int, int]]
) -> dict[Any, PurePath]:
    names = {}
    for image in content["images"]:
        names[image["id"]] = name = _path(file, image["file_name"])
        if "width" in image and "height" in image:
            sizes[name] = int(image["width"]), int(image["height"])
    return names


def _add(
    found: dict[PurePath, list[PersonInImage]],
    items: Sequence[Mapping[str, Any]],
    names: Mapping[Any, PurePath],
) -> None:
    for item in items:
        if any(flat := item["keypoints"]):
            track = track_of(item.get("idx", item.get("track_id")))
            people = found.setdefault(names[item["image_id"]], [])
            people.append(PersonInImage(track, points_of(flat)))


ALPHAPOSE = PoseFormat("AlphaPose's alphapose-results.json of each camera", is_alphapose, read_coco)
COCO = PoseFormat(
    "COCO's JSON of keypoints: annotations, or the list of results", is_coco, read_coco
)
