"""Where people are in the images, by the truth that is written beside the films."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.film.cameras import CAMERAS
from benchmarks.film.compare import JOINT_NAMES
from benchmarks.film.figures import LANDMARK_BONES
from benchmarks.film.references import TrueReference, hidden
from benchmarks.film.truths import read_joints, write_truth
from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.model.arrays import Float64Array

_SPEED = 1.5
"""Metres per second along x of the stand-in for a walker."""


class _Gliding:
    """Has its joints in a column and moves along x."""

    def landmarks(self, times: Float64Array) -> Float64Array:
        n = len(LANDMARK_BONES)
        column = np.stack([np.zeros(n), np.zeros(n), np.linspace(0.1, 1.6, n)], axis=-1)
        return column + np.array([_SPEED, 0, 0]) * (times - 2.0)[:, None, None]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_truth(tmp_path, [_Gliding()], (-1.0, 5.0), 4.0)  # type: ignore[list-item]
    return tmp_path


def test_joints_come_back(folder: Path) -> None:
    joints = read_joints(folder)
    times = np.array([0.0, 1.2345])
    assert joints.names == JOINT_NAMES
    assert np.allclose(joints(times)[:, 0], _Gliding().landmarks(times), atol=1e-4)


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.name)
def test_pixels_are_those_of_the_time_of_each_row(folder: Path, camera) -> None:
    stamp = 2.0 - camera.offset_s
    seen = TrueReference(folder).seen(camera.name, stamp, 0)
    assert seen.clear.all()
    R, t = camera.pose
    pixels = seen.keypoints[0]
    for joint, pixel in enumerate(pixels):
        time = np.array([2.0 + camera.line_time_s * pixel[1]])
        point = _Gliding().landmarks(time)[0, joint]
        assert np.allclose(project(point @ R.T + t, camera.lens), pixel, atol=0.05)


def test_a_person_behind_another_is_hidden() -> None:
    near = np.array([[0, 0], [10, 0], [10, 40], [0, 40.0]])
    pixels = np.stack([near, near * 0.5 + np.array([2.0, 10.0]), near + np.array([100.0, 0.0])])
    assert hidden(pixels, np.array([2.0, 4.0, 4.0])).tolist() == [False, True, False]
    assert hidden(pixels, np.array([4.0, 2.0, 2.0])).tolist() == [False, False, False]
