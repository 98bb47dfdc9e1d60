"""What a source is, found by its content; and what is said of one that is nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stcalib_ros.cli import main
from stcalib_ros.io.formats import FORMATS


@pytest.mark.parametrize(
    ("files", "source", "message"),
    [
        ({}, "none", "no such file or folder: none"),
        ({"x/a.mp4": b"0"}, "x", "x has pictures (.mp4) and no poses: run a pose estimator on"),
        ({"x/a.mp4": b"0"}, "x/a.mp4", "x/a.mp4 has pictures (.mp4) and no poses: run"),
        ({"x/a.jpg": b"0", "x/b.md": b"0", "x/c.jpg": b"0"}, "x", "x has pictures (.jpg)"),
        ({"x/.hidden": b"0"}, "x", "x is an empty folder: name the one to which the pose"),
        (
            {"x/a.json": b""},
            "x",
            "x has only empty files (0 bytes): name the one to which the pose",
        ),
        ({"x/a.log": b"0", "x/b": b"0"}, "x", "a folder of 1 .log, 1 without ending, and none of"),
        ({"x.zip": b"PK\x03\x04"}, "x.zip", "x.zip is an archive: unpack it, and name the folder"),
        ({"x.docx": b"PK\x03\x04"}, "x.docx", "x.docx is a file .docx of 4 bytes, and none of"),
        (
            {"x.mcap": b"\x89MCAP0\r\n"},
            "x.mcap",
            "x.mcap is a bag already: `stcalib doctor x.mcap`",
        ),
        (
            {"p.json": b'{"name": "x", "v": {"a": 1}}'},
            "p.json",
            'begins with "name", "v", "a", and',
        ),
        (
            {"x.json": b'{"a": 1}'},
            "x.json",
            "none of the formats that can be converted: npz, pose2sim",
        ),
        ({"x.npz": b"PK"}, "x.npz", "a file .npz of 2 bytes"),
        ({"x.json": b"\xff\xfe\x00"}, "x.json", "none of the formats"),
    ],
)
def test_what_is_none_of_them(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    files: dict[str, bytes],
    source: str,
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, content in files.items():
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_bytes(content)
    assert main(["convert", source, "out.mcap"]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert "pickle" not in said


def test_objects_of_python_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.savez(tmp_path / "x.npz", camera_names=np.array([{}], dtype=object))
    assert main(["convert", str(tmp_path / "x.npz"), str(tmp_path / "o.mcap")]) == 2
    said = capsys.readouterr().err
    assert "an array of Python objects" in said
    assert "pickle" not in said


def test_a_folder_of_arrays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("a.npz", "b.npz"):
        np.savez(tmp_path / name, camera_names=["cam0"], det_kp2d=np.zeros((0, 17, 3)))
    assert main(["convert", str(tmp_path), str(tmp_path / "o.mcap")]) == 2
    assert "has files of multi-view arrays: name one: a.npz, b.npz" in capsys.readouterr().err


def test_every_format_is_explained() -> None:
    docs = Path(__file__).parents[2] / "docs"
    pages = (docs / "formats.md").read_text() + (docs / "datasets.md").read_text()
    assert [name for name in FORMATS if f"`{name}`" not in pages and f"| {name}" not in pages] == []
