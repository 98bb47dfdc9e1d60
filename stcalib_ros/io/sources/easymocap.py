"""2D poses of an EasyMocap project, whose cameras are not calibrated yet.

::

    PROJECT/annots/CAMERA/000000.json     height, width, annots: personID, keypoints (J, 3)
    PROJECT/intri.yml                     lenses, if they are known

Scenes with their truth (extri.yml, keypoints3d/) are read by `stcalib_ros.io.datasets.easymocap`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePath

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.files import head
from stcalib_ros.io.json_files import read_json
from stcalib_ros.io.lens_files import lenses_of
from stcalib_ros.io.sources.cameras import looked_at, with_suffix
from stcalib_ros.io.sources.form import (
    CameraPoses,
    PoseFormat,
    PoseSource,
    points_of,
    reading,
    track_of,
    whole_number,
)
from stcalib_ros.io.sources.images import PersonInImage, cameras_of_images

_ANNOTATIONS = re.compile(r'"annots"\s*:\s*\[(\s*\]|.*"keypoints")', re.DOTALL)
"""List of the persons in an image, which may be empty."""


def is_easymocap(path: Path, files: Sequence[Path]) -> bool:
    """Whether there are annotations with keypoints, as of EasyMocap."""
    del path
    heads = (head(file) for file in looked_at(files, ".json"))
    return any(_ANNOTATIONS.search(text) for text in heads)


def read_easymocap_2d(path: Path, files: Sequence[Path]) -> PoseSource:
    """Read the poses of all cameras.

    Raises
    ------
    InputError
        A file has another form.
    """
    below = path / "annots" if (path / "annots").is_dir() else path
    found: dict[PurePath, list[PersonInImage]] = {}
    sizes: dict[PurePath, tuple[int, int]] = {}
    for file in with_suffix(files, ".json"):
        if file.is_relative_to(below):
            content = read_json(file)
            with reading(file, "annotations of EasyMocap"):
                found[file] = _people(content)
                if "width" in content and "height" in content:
                    sizes[file] = whole_number(content["width"]), whole_number(content["height"])
    cameras = cameras_of_images(below, found, complete=True, sizes=sizes)
    lenses = path / "intri.yml"
    if lenses.is_file():
        cameras = tuple(_with_lens(camera, lenses) for camera in cameras)
    return PoseSource(path, cameras)


def _with_lens(camera: CameraPoses, file: Path) -> CameraPoses:
    try:
        found = lenses_of(file, [camera.name.removeprefix("cam")], image_size=camera.size)
    except InputError as error:
        return replace(camera, no_lens=str(error))
    return replace(camera, lens=next(iter(found.values())))


def _people(content: Mapping[str, list[Mapping[str, object]]]) -> list[PersonInImage]:
    people = [
        PersonInImage(track_of(person.get("personID")), points_of(person["keypoints"]))  # type: ignore[arg-type]
        for person in content["annots"]
        if "keypoints" in person
    ]
    return [person for person in people if len(person.points)]


EASYMOCAP_2D = PoseFormat(
    "2D poses of an EasyMocap project: annots/, intri.yml", is_easymocap, read_easymocap_2d
)
