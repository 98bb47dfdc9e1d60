from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pose_files import FPS, Seen, assert_read, convert, scene, seen_by
from pose_writers import FREEMOCAP_ARRAY, N, freemocap

from stcalib_ros.cli import main


def test_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    read = convert(freemocap(tmp_path / "r"), "--fps", "30")
    assert "Read as freemocap" in capsys.readouterr().out
    for camera, own in zip(read.cameras, scene().cameras, strict=True):
        np.testing.assert_allclose(camera.intrinsics.K, own.intrinsics.K)
        np.testing.assert_allclose(np.diff(camera.stamps), 1 / FPS, atol=1e-6)
        expected = [[Seen(0, p[0].points)] for p in seen_by(own, "blazepose_33", N)]
        expected[2] = []
        assert_read(camera, expected, tracked=True)


def test_lenses_of_fewer_cameras_are_not_used(tmp_path: Path) -> None:
    read = convert(
        freemocap(tmp_path / "r", n_lenses=2), "--fps", "30", "--image-size", "1920x1080"
    )
    assert not any(camera.intrinsics.known for camera in read.cameras)


def test_unusable(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = freemocap(tmp_path / "r")
    (root / "synchronized_videos").mkdir()
    (root / "synchronized_videos" / "a.mp4").touch()
    assert main(["convert", str(root), str(tmp_path / "o.mcap")]) == 2
    assert "has 1 videos, but points of 3 cameras" in capsys.readouterr().err
    np.save(root / "output_data" / "raw_data" / FREEMOCAP_ARRAY, np.zeros((3, N, 17, 2)))
    assert main(["convert", str(root), str(tmp_path / "o.mcap")]) == 2
    assert "expected (C, F, 33 or more, 2)" in capsys.readouterr().err
    np.save(root / "output_data" / "raw_data" / FREEMOCAP_ARRAY, np.array([{}]), allow_pickle=True)
    assert main(["convert", str(root), str(tmp_path / "o.mcap")]) == 2
    assert "an array of Python objects" in capsys.readouterr().err
