from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pose_files import FPS, Seen, assert_read, convert, scene, seen_by

from stcalib_ros.cli import main

N = 6
NAME = "mediapipe_2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy"


def recording(root: Path, n_lenses: int = 3) -> Path:
    """Points of a body and of a hand; nobody in the third image."""
    xy = np.full((3, N, 54, 2), np.nan)
    for c, camera in enumerate(scene().cameras):
        for k, people in enumerate(seen_by(camera, "blazepose_33", N)):
            points = people[0].points
            xy[c, k, :33] = np.where(points.any(-1, keepdims=True), points[:, :2], np.nan)
    xy[:, 2] = np.nan
    folder = root / "output_data" / "raw_data"
    folder.mkdir(parents=True)
    np.save(folder / NAME, xy)
    lenses = [
        f'[cam_{c}]\nname = "cam_{c}"\nsize = [1920, 1080]\n'
        f"matrix = {camera.intrinsics.K.tolist()}\ndistortions = [0.0, 0.0, 0.0, 0.0, 0.0]\n"
        "rotation = [0.0, 0.0, 0.0]\ntranslation = [0.0, 0.0, 0.0]\n"
        for c, camera in enumerate(scene().cameras[:n_lenses])
    ]
    (root / "walk_camera_calibration.toml").write_text("\n".join([*lenses, "[metadata]\n"]))
    return root


def test_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    read = convert(recording(tmp_path / "r"), "--fps", "30")
    assert "Read as freemocap" in capsys.readouterr().out
    for camera, own in zip(read.cameras, scene().cameras, strict=True):
        np.testing.assert_allclose(camera.intrinsics.K, own.intrinsics.K)
        np.testing.assert_allclose(np.diff(camera.stamps), 1 / FPS, atol=1e-6)
        expected = [[Seen(0, p[0].points)] for p in seen_by(own, "blazepose_33", N)]
        expected[2] = []
        assert_read(camera, expected, tracked=True)


def test_lenses_of_fewer_cameras_are_not_used(tmp_path: Path) -> None:
    read = convert(recording(tmp_path / "r", 2), "--fps", "30", "--image-size", "1920x1080")
    assert not any(camera.intrinsics.known for camera in read.cameras)


def test_unusable(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = recording(tmp_path / "r")
    (root / "synchronized_videos").mkdir()
    (root / "synchronized_videos" / "a.mp4").touch()
    assert main(["convert", str(root), str(tmp_path / "o.mcap")]) == 2
    assert "has 1 videos, but points of 3 cameras" in capsys.readouterr().err
    np.save(root / "output_data" / "raw_data" / NAME, np.zeros((3, N, 17, 2)))
    assert main(["convert", str(root), str(tmp_path / "o.mcap")]) == 2
    assert "expected (C, F, 33 or more, 2)" in capsys.readouterr().err
    np.save(root / "output_data" / "raw_data" / NAME, np.array([{}]), allow_pickle=True)
    assert main(["convert", str(root), str(tmp_path / "o.mcap")]) == 2
    assert "an array of Python objects" in capsys.readouterr().err
