from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pose_files import assert_read, convert, scene, seen_by
from pose_writers import N, easymocap_2d

from stcalib_ros.cli import main


@pytest.mark.parametrize("lenses", [True, False])
def test_project(tmp_path: Path, lenses: bool, capsys: pytest.CaptureFixture[str]) -> None:
    recording = convert(easymocap_2d(tmp_path / "p", lenses=lenses), "--fps", "30")
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
    root = easymocap_2d(tmp_path / "p", lenses=False)
    file = root / "annots" / "2" / "000003.json"
    file.write_text(file.read_text().replace("1920", "640"))
    assert main(["convert", str(root), str(tmp_path / "o.mcap"), "--fps", "30"]) == 2
    assert "images of cam2 have 640 x 1080 and 1920 x 1080 px" in capsys.readouterr().err


def test_a_camera_whose_lens_is_missing_takes_that_of_the_arguments(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = easymocap_2d(tmp_path / "p", lenses=True)
    text = (root / "intri.yml").read_text().replace("1400.", "1401.", 1)
    (root / "intri.yml").write_text(text.replace("K_2", "K_7").replace("dist_2", "dist_7"))
    convert_it = ["convert", str(root), str(tmp_path / "o.mcap"), "--fps", "30"]
    assert main(convert_it) == 2
    said = capsys.readouterr().err
    assert "intri.yml has no lens of 2: it has 1, 7, 3" in said
    assert said.endswith("; give the lenses with --intrinsics FILE\n")
    other = tmp_path / "intri.yml"
    other.write_text(text.replace("K_", "K_cam").replace("dist_", "dist_cam"))
    assert main([*convert_it, "--intrinsics", str(other)]) == 0
