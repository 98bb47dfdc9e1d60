"""Times of images from tables."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from pose_files import convert, scene, seen_by

from stcalib_ros.cli import main
from stcalib_ros.io.sources.tables import stamps_of

N = 4
TIMES = [1_760_000_000.0, 1_760_000_000.04, 1_760_000_000.081, 1_760_000_000.12]


def poses(folder: Path) -> Path:
    for name, camera in zip(("a", "b"), scene().cameras, strict=False):
        (folder / name).mkdir(parents=True)
        for k, people in enumerate(seen_by(camera, "body_25", N)):
            found = [{"pose_keypoints_2d": one.points.ravel().tolist()} for one in people]
            (folder / name / f"{k}.json").write_text(json.dumps({"people": found}))
    return folder


def convert_with(folder: Path, stamps: Path) -> list[np.ndarray]:
    arguments = ["--stamps", str(stamps), "--image-size", "1920x1080"]
    return [camera.stamps for camera in convert(poses(folder / "x"), *arguments).cameras]


def test_one_table(tmp_path: Path) -> None:
    rows = [f"{c},{k},{t:.3f}" for c in "ab" for k, t in enumerate([*TIMES, 1_760_000_001.0])]
    (tmp_path / "t.csv").write_text("\n".join(["Camera, Frame ,stamp", *rows]))
    for stamps in convert_with(tmp_path, tmp_path / "t.csv"):
        np.testing.assert_allclose(stamps, [0, 0.04, 0.081, 0.12, 1.0])


def test_a_table_for_each_camera(tmp_path: Path) -> None:
    (tmp_path / "t").mkdir()
    for c, name in enumerate("ab"):
        rows = [f"{round(t * 1000) + 7 * c}" for t in TIMES]
        (tmp_path / "t" / f"{name}.csv").write_text("\n".join(["timestamp_ms", *rows]))
    a, b = convert_with(tmp_path, tmp_path / "t")
    np.testing.assert_allclose(a, [0, 0.04, 0.081, 0.12])
    np.testing.assert_allclose(b - a, 0.007)


@pytest.mark.parametrize(
    ("column", "value", "expected"),
    [
        ("stamp", "1760000000.123456789", 1_760_000_000_123_456_789),
        ("stamp", "1760000000123", 1_760_000_000_123_000_000),
        ("stamp", "1760000000123456", 1_760_000_000_123_456_000),
        ("stamp", "1760000000123456789", 1_760_000_000_123_456_789),
        ("time_ms", "40.5", 40_500_000),
        ("frame_time", "12.5", 12_500_000_000),
    ],
)
def test_units(column: str, value: str, expected: int) -> None:
    assert stamps_of(column, [value]) == [expected]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("camera,frame\na,0", "has the columns camera, frame: expected camera, frame and stamp"),
        ("camera,frame,stamp\nc,0,1", "has no times of a, but of c"),
        ("camera,frame,stamp\na,0,1", "has no time of image 1 of a"),
        ("camera,frame,stamp\na,0,1\na,0,2", "image 0 of a has two times"),
        ("camera,frame,stamp\na,0,nan", "stamp has a value that is not finite"),
        ("camera,frame,stamp\na,-1,2", "-1 is no number of an image"),
        (
            "camera,frame,stamp\n" + "\n".join(f"{c},{k},{9 - k}" for c in "ab" for k in range(N)),
            "image 1 is at 8.000000 s, the one before at 9.000000 s",
        ),
    ],
)
def test_unusable(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    (tmp_path / "t.csv").write_text(text)
    command = ["convert", str(poses(tmp_path / "x")), str(tmp_path / "o.mcap")]
    arguments = ["--stamps", str(tmp_path / "t.csv"), "--image-size", "1920x1080"]
    assert main([*command, *arguments]) == 2
    assert message in capsys.readouterr().err
