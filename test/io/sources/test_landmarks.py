"""Landmarks of MediaPipe: one person, who is not in the third image."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pose_files import assert_read, convert
from pose_writers import N, first_person, landmarks, mediapipe_arrays

from stcalib_ros.cli import main
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS

NAMES = LAYOUTS["blazepose_33"].joint_names
SIZE = ["--image-size", "1920x1080"]


def assert_all_read(source: Path, *arguments: str) -> None:
    for c, camera in enumerate(convert(source, *arguments).cameras):
        assert camera.layout.name == "blazepose_33"
        assert_read(camera, first_person(c), tracked=True, atol_px=0.01)


@pytest.mark.parametrize(
    ("more", "arguments"),
    [
        ({}, [*SIZE, "--fps", "30"]),
        ({"image_size": [1920, 1080], "fps": 30.0}, []),
        ({"timestamp_ms": 1000 + 33 * np.arange(N), "frame": np.arange(N)}, SIZE),
    ],
)
def test_arrays(
    tmp_path: Path, more: dict[str, Any], arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert_all_read(mediapipe_arrays(tmp_path / "mp", **more), *arguments)
    assert "Read as mediapipe" in capsys.readouterr().out


@pytest.mark.parametrize("named", [True, False])
def test_a_row_for_each_landmark(tmp_path: Path, named: bool) -> None:
    (tmp_path / "mp").mkdir()
    for c in range(3):
        rows = ["frame,landmark,x,y,z,visibility"]
        for k, people in enumerate(landmarks(c)):
            for j, (x, y, z, v) in enumerate(people):
                if np.isfinite(x):
                    joint = f"PoseLandmark.{NAMES[j].upper()}" if named else j
                    rows.append(f"{k},{joint},{x},{y},{z},{v}")
        (tmp_path / "mp" / f"cam{c}.csv").write_text("\n".join(rows))
    assert_all_read(tmp_path / "mp", *SIZE, "--fps", "30")


@pytest.mark.parametrize("first", ["x0", "x1", "name"])
def test_a_row_for_each_image(tmp_path: Path, first: str) -> None:
    """In px, with times; columns are numbered from 0 or 1, or named."""
    (tmp_path / "mp").mkdir()
    keys = NAMES if first == "name" else range(int(first[1]), 33 + int(first[1]))
    header = [f"{j}_{k}" if first == "name" else f"{k}{j}" for j in keys for k in "xyv"]
    for c in range(3):
        rows = [",".join(["timestamp_ms", *header])]
        for k, people in enumerate(landmarks(c)):
            px = people[:, [0, 1, 3]] * (1920, 1080, 1)
            rows.append(
                ",".join([f"{33 * k}", *("" if np.isnan(n) else f"{n}" for n in px.ravel())])
            )
        (tmp_path / "mp" / f"cam{c}.csv").write_text("\n".join(rows))
    assert_all_read(tmp_path / "mp", *SIZE)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        (
            {"landmarks": np.zeros((5, 17, 4))},
            "landmarks has shape (5, 17, 4), expected (F, 33, 4)",
        ),
        ({"landmarks": np.full((5, 33, 4), np.nan)}, "has nobody in any of 5 images"),
        (
            {"landmarks": np.zeros((5, 33, 4)), "frame": np.full(5, -1)},
            "-1 is no number of an image",
        ),
        (
            {"landmarks": np.zeros((5, 33, 4)), "frame": np.arange(3)},
            "is not landmarks of MediaPipe",
        ),
        ({"landmarks": np.array([None])}, "an array of Python objects"),
        ({"keypoints": np.array(["x"])}, "is not landmarks of MediaPipe"),
    ],
)
def test_unusable(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arrays: dict[str, Any], message: str
) -> None:
    np.savez(tmp_path / "x.npz", **arrays)
    command = ["convert", str(tmp_path / "x.npz"), str(tmp_path / "o.mcap"), "--fps", "30", *SIZE]
    assert main(command) == 2
    assert message in capsys.readouterr().err


def test_a_landmark_that_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "x.csv").write_text("frame,landmark,x,y\n0,33,0.5,0.5\n")
    command = ["convert", str(tmp_path / "x.csv"), str(tmp_path / "o.mcap"), "--fps", "30", *SIZE]
    assert main(command) == 2
    assert "landmark 33: the pose has 33" in capsys.readouterr().err
