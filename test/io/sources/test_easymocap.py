from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from pose_files import assert_read, convert, scene, seen_by

from stcalib_ros.cli import main

N = 6


def project(root: Path, *, lenses: bool) -> Path:
    """Cameras are called 1, 2 and 3; a box without keypoints is nobody."""
    for c, camera in enumerate(scene().cameras):
        folder = root / "annots" / f"{c + 1}"
        folder.mkdir(parents=True)
        for k, people in enumerate(seen_by(camera, "body_25", N)):
            annots = [
                {"personID": one.track, "bbox": [0, 0, 9, 9, 1], "keypoints": one.points.tolist()}
                for one in people
            ]
            content = {"filename": f"images/{c + 1}/{k:06d}.jpg", "height": 1080, "width": 1920}
            content |= {"annots": [*annots, {"personID": 99, "bbox": [0, 0, 9, 9, 1]}]}
            (folder / f"{k:06d}.json").write_text(json.dumps(content))
    if lenses:
        storage = cv2.FileStorage(str(root / "intri.yml"), cv2.FILE_STORAGE_WRITE)
        for c, camera in enumerate(scene().cameras):
            storage.write(f"K_{c + 1}", camera.intrinsics.K)
            storage.write(f"dist_{c + 1}", np.zeros((1, 5)))
        storage.release()
    return root


@pytest.mark.parametrize("lenses", [True, False])
def test_project(tmp_path: Path, lenses: bool, capsys: pytest.CaptureFixture[str]) -> None:
    recording = convert(project(tmp_path / "p", lenses=lenses), "--fps", "30")
    assert "Read as easymocap_2d" in capsys.readouterr().out
    for c, (camera, own) in enumerate(zip(recording.cameras, scene().cameras, strict=True)):
        assert camera.name == f"cam{c + 1}"
        assert camera.intrinsics.known == lenses
        if lenses:
            np.testing.assert_allclose(camera.intrinsics.K, own.intrinsics.K)
        assert_read(camera, seen_by(own, "body_25", N), tracked=True)


@pytest.mark.parametrize(
    "content",
    [
        '{"annots": 3, "keypoints": 1}',
        '{"annots": [{"keypoints": [[1, 2]]}]}',
        '["annots", "keypoints"]',
    ],
)
def test_unusable(tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str) -> None:
    (tmp_path / "annots" / "a").mkdir(parents=True)
    (tmp_path / "annots" / "a" / "0.json").write_text(content)
    command = ["convert", str(tmp_path), str(tmp_path / "o.mcap"), "--format", "easymocap_2d"]
    assert main([*command, "--fps", "30"]) == 2
    assert "is not annotations of EasyMocap" in capsys.readouterr().err


def test_images_of_two_sizes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = project(tmp_path / "p", lenses=False)
    file = root / "annots" / "2" / "000003.json"
    file.write_text(file.read_text().replace("1920", "640"))
    assert main(["convert", str(root), str(tmp_path / "o.mcap"), "--fps", "30"]) == 2
    assert "images of cam2 have 640 x 1080 and 1920 x 1080 px" in capsys.readouterr().err
