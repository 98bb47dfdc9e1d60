"""Folders as people have them: from Windows or a Mac, linked, incomplete, with other files."""

from __future__ import annotations

import csv
import gzip
import io
import json
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np
import pose_writers as writers
import pytest
from pose_files import assert_read, convert, scene, seen_by
from pose_writers import N

from stcalib_ros.cli import main
from stcalib_ros.core.model.recording import Recording

RATE = ["--fps", "30"]
SIZE = [*RATE, "--image-size", "1920x1080"]


def coco(root: Path) -> Path:
    root.mkdir()
    writers.coco_annotations(root / "all.json")
    return root


def landmark_tables(root: Path, separator: str = ",", decimal: str = ".") -> Path:
    root.mkdir()
    for c in range(3):
        table = io.StringIO()
        rows = csv.writer(table, delimiter=separator)
        rows.writerow(["frame", "landmark", "x", "y", "visibility"])
        for k, points in enumerate(writers.landmarks(c)):
            for joint, (x, y, _, score) in enumerate(points):
                if np.isfinite(x):
                    numbers = [f"{v:.6f}".replace(".", decimal) for v in (x, y, score)]
                    rows.writerow([k, joint, *numbers])
        (root / f"cam{c}.csv").write_text(table.getvalue())
    return root


WRITERS: Mapping[str, tuple[Callable[[Path], Path], list[str]]] = {
    "openpose": (lambda root: writers.openpose(root, N), SIZE),
    "alphapose": (lambda root: writers.alphapose(root, tracked=True), SIZE),
    "mmpose": (lambda root: writers.mmpose_videos(root, described=False), SIZE),
    "coco": (coco, RATE),
    "ultralytics": (lambda root: writers.ultralytics(root, "id"), SIZE),
    "caliscope": (writers.caliscope, []),
    "easymocap_2d": (lambda root: writers.easymocap_2d(root, lenses=True), RATE),
    "freemocap": (writers.freemocap, RATE),
    "mediapipe": (landmark_tables, SIZE),
}


def text_files(root: Path) -> Iterable[Path]:
    endings = (".json", ".csv", ".txt", ".toml", ".yml")
    return [file for file in root.rglob("*") if file.suffix in endings]


def on_windows(root: Path, encoding: str) -> None:
    for file in text_files(root):
        text = file.read_text().replace("\n", "\r\n")
        file.write_bytes(text.encode(encoding))


def from_a_mac(root: Path) -> None:
    """As an archive of the Finder is unpacked elsewhere."""
    for folder in [root, *(path for path in root.rglob("*") if path.is_dir())]:
        (folder / ".DS_Store").write_bytes(b"\0\0\0\1Bud1")
    for file in text_files(root):
        file.with_name(f"._{file.name}").write_bytes(b"\0\5\26\7")
        twin = root / "__MACOSX" / file.relative_to(root)
        twin.parent.mkdir(parents=True, exist_ok=True)
        twin.write_bytes(b"\0\5\26\7")


def with_other_files(root: Path) -> None:
    (root / "notes.txt").write_text("cam0 is at the door\n")
    (root / "settings.json").write_text('{"model": "big", "threshold": 0.3}')
    (root / "times.csv").write_text("a,b\n1,2\n")
    (root / "logs").mkdir()
    (root / "logs" / "log.json").write_text("[]")
    (root / "logs" / "cam0.mp4").write_bytes(b"\0" * 64)


def behind_links(root: Path) -> None:
    """Each entry is a link to another disk, and one leads back to the folder itself."""
    disk = root.with_name("disk")
    disk.mkdir()
    for entry in list(root.iterdir()):
        entry.rename(disk / entry.name)
        entry.symlink_to(disk / entry.name)
    (root / "again").symlink_to(root)


UNTIDY: Mapping[str, Callable[[Path], None]] = {
    "windows": lambda root: on_windows(root, "utf-8-sig"),
    "powershell": lambda root: on_windows(root, "utf-16"),
    "mac": from_a_mac,
    "other files": with_other_files,
    "links": behind_links,
}


def summary(recording: Recording) -> list[tuple[str, int, int]]:
    return [
        (c.name, len(c.stamps), sum(len(track.frames) for track in c.tracks))
        for c in recording.cameras
    ]


@pytest.mark.parametrize("name", WRITERS)
def test_untidy_folders_are_read_as_tidy_ones(tmp_path: Path, name: str) -> None:
    write, arguments = WRITERS[name]
    expected = summary(convert(write(tmp_path / "tidy"), *arguments))
    assert len(expected) == 3
    for how, change in UNTIDY.items():
        (tmp_path / how).mkdir()
        root = write(tmp_path / how / "my poses")
        change(root)
        assert summary(convert(root, *arguments)) == expected, how


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["Küche", "Köche", "Flur"], ["Flur", "Koche", "Kuche"]),
        (["Cam 1", "Cam 2", "Cam 10"], ["Cam_1", "Cam_2", "Cam_10"]),
        (["192.168.1.9", "192.168.1.10", "7"], ["cam7", "cam192_168_1_9", "cam192_168_1_10"]),
    ],
)
def test_names_of_cameras(tmp_path: Path, names: list[str], expected: list[str]) -> None:
    root = writers.openpose(tmp_path / "p", N)
    for camera, name in zip(scene().cameras, names, strict=True):
        (root / f"{camera.name}_json").rename(root / name)
    assert [camera.name for camera in convert(root, *SIZE).cameras] == expected


def without_letters(root: Path) -> None:
    (root / "cam0_json").rename(root / "客厅")
    (root / "cam1_json").rename(root / "厨房")


def without_people(root: Path) -> None:
    for file in root.rglob("*.json"):
        file.write_text('{"people": []}')


def with_lists_of_nobody(root: Path) -> None:
    for file in root.rglob("*.json"):
        file.write_text("[]\n")


def packed(root: Path) -> None:
    for file in list(root.rglob("*.json")):
        file.with_suffix(".json.gz").write_bytes(gzip.compress(file.read_bytes()))
        file.unlink()


def empty(root: Path) -> None:
    next(iter(sorted(root.rglob("*.json")))).write_text("")


def cut(root: Path) -> None:
    file = next(iter(sorted(root.rglob("*.json"))))
    file.write_text(file.read_text()[:200])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (without_letters, "厨房/walk_ gives its camera no name: rename it; names of cameras are"),
        (without_people, "has nobody in any of 24 images (OpenPose's JSON, a file for each image)"),
        (with_lists_of_nobody, "has JSON files that are empty lists: the pose estimator found no"),
        (packed, "has packed files (.gz): unpack them first"),
        (empty, "walk_000000000000_keypoints.json is empty: write it again, or remove it"),
        (cut, "walk_000000000000_keypoints.json is not valid JSON: "),
        (cut, "; was it written to its end?"),
    ],
)
def test_what_is_said(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: Callable[[Path], None],
    message: str,
) -> None:
    root = writers.openpose(tmp_path / "p", N)
    change(root)
    assert main(["convert", str(root), str(tmp_path / "o.mcap"), *SIZE]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("root", "file"), [("mmpose", "results_cam1.json"), ("mediapipe", "cam1.csv")]
)
def test_no_camera_is_lost_with_an_empty_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], root: str, file: str
) -> None:
    write, arguments = WRITERS[root]
    (write(tmp_path / "p") / file).write_text("")
    assert main(["convert", str(tmp_path / "p"), str(tmp_path / "o.mcap"), *arguments]) == 2
    assert f"{file} is empty: write it again, or remove it" in capsys.readouterr().err


def test_no_camera_is_lost_with_its_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    root = writers.openpose(tmp_path / "p", N)
    scan = os.scandir

    def refused(folder: str) -> object:
        if folder.endswith("cam1_json"):
            raise PermissionError(13, "Permission denied", folder)
        return scan(folder)

    with monkeypatch.context() as patch:
        patch.setattr(os, "scandir", refused)
        assert main(["convert", str(root), str(tmp_path / "o.mcap"), *SIZE]) == 2
    assert "cam1_json: Permission denied" in capsys.readouterr().err


def test_no_camera_is_lost_with_a_disk_that_is_not_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = writers.openpose(tmp_path / "p", N)
    (root / "cam3_json").symlink_to(tmp_path / "disk" / "cam3_json")
    assert main(["convert", str(root), str(tmp_path / "o.mcap"), *SIZE]) == 2
    said = capsys.readouterr().err
    assert "cam3_json is a link to " in said
    assert "disk/cam3_json, which is not there" in said


def test_numbers_as_text(tmp_path: Path) -> None:
    """As some programs write JSON; -1 is nobody's id in quotes, too."""

    def as_text(value: object) -> object:
        if isinstance(value, dict):
            return {key: as_text(one) for key, one in value.items()}
        return [as_text(one) for one in value] if isinstance(value, list) else str(value)

    root = writers.openpose(tmp_path / "p", N)
    for file in root.rglob("*.json"):
        file.write_text(json.dumps(as_text(json.loads(file.read_text()))))
    for camera, own in zip(convert(root, *SIZE).cameras, scene().cameras, strict=True):
        assert_read(camera, seen_by(own, "body_25", N), tracked=False)


@pytest.mark.parametrize(("separator", "decimal"), [(";", ","), ("\t", "."), (";", ".")])
def test_tables_of_spreadsheets(tmp_path: Path, separator: str, decimal: str) -> None:
    expected = summary(convert(landmark_tables(tmp_path / "p"), *SIZE))
    written = landmark_tables(tmp_path / "q", separator, decimal)
    assert summary(convert(written, *SIZE)) == expected
