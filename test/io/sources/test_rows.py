"""The table of docs/formats.md: the two commands of each row are what such a source needs."""

from __future__ import annotations

import random
import re
import shlex
from collections.abc import Callable, Mapping
from pathlib import Path

import pose_writers as writers
import pytest

from stcalib_ros.cli import main
from stcalib_ros.io.sources import SOURCES

PAGE = Path(__file__).parents[3] / "docs" / "formats.md"
ROW = re.compile(
    r"\| `(\w+)` \| [^|]+ \| `stcalib (convert [^`]+)`<br>`stcalib (calibrate [^`]+)` \|$"
)
ROWS = {m[1]: (m[2], m[3]) for line in PAGE.read_text().splitlines() if (m := ROW.search(line))}


def freemocap(root: Path) -> Path:
    writers.freemocap(root)
    for c in range(3):
        video = root / "synchronized_videos" / f"cam_{c}.mp4"
        writers.write_video(video, (1920, 1080), 30.0)
    return root


CAMERAS = ["cam01", "cam02", "cam03"]
WRITERS: Mapping[str, Callable[[Path], Path]] = {
    "openpose": lambda root: writers.openpose(root, 4),
    "alphapose": lambda root: writers.alphapose(root, tracked=True),
    "mmpose": lambda root: writers.mmpose_videos(root, described=True),
    "coco": lambda root: writers.coco_annotations(root.with_suffix(".json")),
    "ultralytics": lambda root: writers.ultralytics(root, "conf id"),
    "mediapipe": writers.mediapipe_arrays,
    "pose2sim": lambda root: writers.pose2sim(root, names=CAMERAS, rate="30"),
    "caliscope": writers.caliscope,
    "easymocap_2d": lambda root: writers.easymocap_2d(root, lenses=True),
    "freemocap": freemocap,
}


def test_every_format_has_its_row_and_is_written_here() -> None:
    assert set(ROWS) - {"npz"} == set(SOURCES) == set(WRITERS)


@pytest.mark.parametrize("name", SOURCES)
def test_the_two_commands_of_a_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """The first one is enough, and says the second."""
    monkeypatch.chdir(tmp_path)
    first, second = ROWS[name]
    source = WRITERS[name](tmp_path / "source")
    assert main([str(source) if w == "SOURCE" else w for w in shlex.split(first)]) == 0
    said = capsys.readouterr().out
    assert f"Read as {name}:" in said
    assert said.endswith(f"Next: stcalib {second}\n")


@pytest.mark.parametrize("name", SOURCES)
def test_damaged_files_are_an_error_of_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """A file is cut, or a number in it becomes something else; no exception gets out."""
    source = WRITERS[name](tmp_path / "source")
    files = [source] if source.is_file() else sorted(f for f in source.rglob("*") if f.is_file())
    files = [file for file in files if file.suffix != ".mp4"]
    rng = random.Random(name)
    for _ in range(6):
        file = rng.choice(files)
        whole = file.read_bytes()
        at = rng.randrange(len(whole))
        other = rng.choice([b"", b"-1e999", b"null", b"[", b"9" * 30, b"\xff"])
        file.write_bytes(whole[:at] + (other + whole[at + 1 :] if rng.random() < 0.7 else b""))
        arguments = ["--fps", "30", "--image-size", "1920x1080", "--format", name]
        assert main(["convert", str(source), str(tmp_path / "o.mcap"), *arguments]) in (0, 2)
        assert capsys.readouterr().err.count("\n") <= 1
        file.write_bytes(whole)
