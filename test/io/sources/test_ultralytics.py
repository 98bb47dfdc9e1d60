from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pose_files import assert_read, convert, scene, seen_by
from pose_writers import N, ultralytics

from stcalib_ros.cli import main

ARGUMENTS = ["--fps", "30", "--image-size", "1920x1080"]


@pytest.mark.parametrize("more", ["", "conf", "id", "conf id"])
def test_labels(tmp_path: Path, more: str, capsys: pytest.CaptureFixture[str]) -> None:
    recording = convert(ultralytics(tmp_path / "runs", more), *ARGUMENTS)
    assert "Read as ultralytics" in capsys.readouterr().out
    for camera, own in zip(recording.cameras, scene().cameras, strict=True):
        expected = seen_by(own, "coco_17", N)
        expected[4] = []
        assert_read(camera, expected, tracked="id" in more, atol_px=0.01)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["0 0.5 0.5 0.1 0.1", "0 0.1 0.1 0.1 0.1"], "labels of boxes alone are no poses"),
        (["0 0.5 0.5 0.1 " + "0.3 " * 52, "x"], "is not a file of Ultralytics' pose labels"),
        (["0 " + "0.3 " * 55, "0 " + "0.3 " * 57], "some lines have ids or confidences, and other"),
        (["0 " + "0.3 " * 56 + "-3"], "is no number of an image or person"),
    ],
)
def test_unusable(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], lines: list[str], message: str
) -> None:
    path = tmp_path / "walk_1.txt"
    path.write_text("\n".join(lines))
    command = ["convert", str(path), str(tmp_path / "o.mcap"), "--format", "ultralytics"]
    assert main([*command, *ARGUMENTS]) == 2
    assert message in capsys.readouterr().err


def test_other_texts_are_not_taken_for_labels(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    np.savetxt(tmp_path / "numbers.txt", np.full((4, 60), 7.0))
    assert main(["convert", str(tmp_path), str(tmp_path / "o.mcap"), *ARGUMENTS]) == 2
    assert "none of the formats" in capsys.readouterr().err
