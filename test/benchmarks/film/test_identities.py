"""Persons of a calibration beside those of the film."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.film.cameras import CAMERAS, truth
from benchmarks.film.figures import LANDMARK_BONES
from benchmarks.film.identities import people_right
from benchmarks.film.references import TrueReference
from benchmarks.film.truths import write_truth
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import PersonAssociation
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.core.model.recording import CameraRecording, Recording, Track

_STAMPS = np.arange(10) / 10


class _Standing:
    def __init__(self, x: float) -> None:
        self._x = x

    def landmarks(self, times: Float64Array) -> Float64Array:
        n = len(LANDMARK_BONES)
        column = np.stack([np.full(n, self._x), np.zeros(n), np.linspace(0.1, 1.6, n)], axis=-1)
        return np.tile(column, (len(times), 1, 1))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    people = [_Standing(-0.6), _Standing(0.6)]
    write_truth(tmp_path, people, (-2.0, 4.0), 2.0)  # type: ignore[arg-type]
    return tmp_path


def _recording(folder: Path) -> Recording:
    """Return two cameras in which track 7 is person 0 and track 8 is person 1."""
    reference, layout = TrueReference(folder), LAYOUTS["coco_17"]
    cameras = []
    for camera in CAMERAS[:2]:
        seen = [reference.seen(camera.name, stamp, 0).keypoints for stamp in _STAMPS]
        order = [list(LANDMARK_BONES).index(name) for name in layout.joint_names]
        points = np.array(seen)[:, :, order] + 1.0
        tracks = tuple(
            Track(
                7 + person,
                np.arange(len(_STAMPS)),
                points[:, person],
                np.full((len(_STAMPS), 17, 3), np.nan),
                np.ones((len(_STAMPS), 17)),
            )
            for person in (0, 1)
        )
        frame = f"{camera.name}_optical_frame"
        cameras.append(
            CameraRecording(camera.name, frame, camera.lens, layout, 5.0 + _STAMPS, tracks)
        )
    return Recording(tuple(cameras))


@pytest.mark.parametrize(
    ("tracks", "right"),
    [
        ([{"cam0": (7,), "cam1": (7,)}, {"cam0": (8,), "cam1": (8,)}], 2),
        ([{"cam0": (7,), "cam1": (8,)}, {"cam0": (8,), "cam1": (7,)}], 0),
        ([{"cam0": (7,), "cam1": (7,)}, {"cam0": (8,), "cam1": (7,)}], 1),
        ([{"cam0": (7,)}, {"cam1": (7,)}], 0),
        ([{"cam0": (7, 99), "cam1": (7,)}], 0),
    ],
    ids=["right", "exchanged", "one", "split", "unknown track"],
)
def test_people_are_right_if_all_their_tracks_are_one_true_person(
    folder: Path, tracks: Sequence[Mapping[str, tuple[int, ...]]], right: int
) -> None:
    persons = tuple(PersonAssociation(k, one, 1.0) for k, one in enumerate(tracks))
    result = replace(truth(2.0), persons=persons)
    assert people_right(result, _recording(folder), folder) == right
