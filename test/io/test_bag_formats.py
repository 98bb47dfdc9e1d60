"""Bags as recorders and other tools leave them: all give the same recording."""

from __future__ import annotations

import re
import shutil
import sqlite3
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

import bag_helpers as bags
import pytest
import yaml
import zstandard
from bag_storages import rewritten, sqlite
from mcap.writer import CompressionType, IndexType

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.io.bag import open_bag, read_bag
from stcalib_ros.io.bag_source import raw_messages
from stcalib_ros.io.bag_writer import write_bag

RECORDING = bags.small_recording()


def plain(folder: Path) -> Path:
    write_bag(RECORDING, folder / "plain.mcap")
    return folder / "plain.mcap"


def metadata(folder: Path, files: Sequence[str], storage: str = "mcap", mode: str = "") -> Path:
    information = {
        "version": 5,
        "storage_identifier": storage,
        "compression_format": "zstd" if mode else "",
        "compression_mode": mode,
        "relative_file_paths": list(files),
    }
    text = yaml.safe_dump({"rosbag2_bagfile_information": information})
    (folder / "metadata.yaml").write_text(text)
    return folder


def folder_of(folder: Path, *names: str) -> Path:
    (folder / "bag").mkdir()
    for name in names:
        shutil.copy(folder / "plain.mcap", folder / "bag" / name)
    return folder / "bag"


def humble(folder: Path) -> Path:
    (folder / "bag").mkdir()
    sqlite(folder / "plain.mcap", folder / "bag/b_0.db3", definitions=False, pack=bytes)
    return metadata(folder / "bag", ["b_0.db3"], "sqlite3")


def packed_sqlite(folder: Path) -> Path:
    target = folder / "a.db3"
    pack = zstandard.ZstdCompressor().compress
    return sqlite(folder / "plain.mcap", target, definitions=False, pack=pack)


def packed_file(folder: Path, source: Path) -> Path:
    target = folder / f"{source.name}.zstd"
    target.write_bytes(zstandard.ZstdCompressor().compress(source.read_bytes()))
    return target


def packed_folder(folder: Path) -> Path:
    (folder / "bag").mkdir()
    packed_file(folder / "bag", folder / "plain.mcap")
    return metadata(folder / "bag", ["plain.mcap.zstd"], mode="FILE")


def idl(kind: str) -> tuple[str, bytes]:
    return "ros2idl", f"{'=' * 80}\nIDL: {kind}\nmodule m {{ }};\n".encode()


def killed(folder: Path) -> Path:
    """The recorder was killed after it had opened the next file."""
    bag = folder_of(folder, "b_0.mcap")
    (bag / "b_1.mcap").touch()
    (bag / "metadata.yaml").write_text("rosbag2_bag")
    return bag


FORMATS: dict[str, tuple[Callable[[Path], Path], str | None]] = {
    "plain": (lambda f: f / "plain.mcap", None),
    "lz4": (
        lambda f: rewritten(f / "plain.mcap", f / "a.mcap", compression=CompressionType.LZ4),
        None,
    ),
    "without chunks": (
        lambda f: rewritten(f / "plain.mcap", f / "a.mcap", use_chunking=False),
        None,
    ),
    "without index": (
        lambda f: rewritten(f / "plain.mcap", f / "a.mcap", index_types=IndexType.NONE),
        None,
    ),
    "many chunks": (lambda f: rewritten(f / "plain.mcap", f / "a.mcap", chunk_size=500), None),
    "without summary": (
        lambda f: rewritten(
            f / "plain.mcap",
            f / "a.mcap",
            index_types=IndexType.NONE,
            repeat_channels=False,
            repeat_schemas=False,
            use_statistics=False,
            use_summary_offsets=False,
        ),
        None,
    ),
    "Humble": (humble, r"lacks the message definitions of 4 topics: /cam0/camera_info, "),
    "SQLite file": (lambda f: humble(f) / "b_0.db3", "of 4 topics"),
    "SQLite of Iron": (
        lambda f: sqlite(f / "plain.mcap", f / "a.db3", definitions=True, pack=bytes),
        None,
    ),
    "SQLite, folder without metadata": (
        lambda f: (humble(f) / "metadata.yaml").unlink() or f / "bag",
        "of 4 topics",
    ),
    "SQLite, messages packed": (packed_sqlite, "of 4 topics"),
    "SQLite, file packed": (lambda f: packed_file(f, humble(f) / "b_0.db3"), "of 4 topics"),
    "reindexed": (lambda f: metadata(folder_of(f, "b_0.mcap"), ["b_0.mcap"], ""), None),
    "old release": (lambda f: metadata(folder_of(f, "b_0.mcap"), ["bag/b_0.mcap"]), None),
    "without metadata": (lambda f: folder_of(f, "b_0.mcap"), None),
    "renamed": (
        lambda f: metadata(folder_of(f, "walk.mcap"), ["b_0.mcap"]),
        r"lists 1 files that are missing: b_0\.mcap; the others are read: walk\.mcap",
    ),
    "one split lost": (
        lambda f: metadata(folder_of(f, "b_1.mcap"), ["b_0.mcap", "b_1.mcap"]),
        r"lists 1 files that are missing: b_0\.mcap; the others are read: b_1\.mcap",
    ),
    "killed": (killed, r"1 of 2 files are empty \(0 bytes\) and left out: b_1\.mcap"),
    "definitions as IDL": (
        lambda f: rewritten(f / "plain.mcap", f / "a.mcap", definition=idl),
        "of 4 topics",
    ),
    "definitions empty": (
        lambda f: rewritten(f / "plain.mcap", f / "a.mcap", definition=lambda _: ("", b"")),
        "of 4 topics",
    ),
    "messages packed": (
        lambda f: rewritten(
            f / "plain.mcap", f / "a.mcap", pack=zstandard.ZstdCompressor().compress
        ),
        None,
    ),
    "file packed": (lambda f: packed_file(f, f / "plain.mcap"), None),
    "file of folder packed": (packed_folder, None),
}


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_recording(tmp_path: Path, name: str) -> None:
    plain(tmp_path)
    make, warning = FORMATS[name]
    path = make(tmp_path)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    warnings: list[str] = []
    recording: Recording = read_bag(path, warn=warnings.append)
    bags.assert_same(recording, RECORDING)
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before
    if warning is None:
        assert not warnings
    else:
        assert any(re.search(warning, line) for line in warnings), warnings


@pytest.mark.parametrize("name", ["plain", "many chunks", "without chunks", "Humble"])
def test_in_time_is_by_log_time(tmp_path: Path, name: str) -> None:
    plain(tmp_path)
    files, cameras = open_bag(FORMATS[name][0](tmp_path), warn=lambda _: None)
    topics = frozenset(c.pose_topic for c in cameras)
    times = [m.log_time for m in raw_messages(files, topics, in_time=True)]
    assert len(times) == sum(len(c.stamps) for c in RECORDING.cameras)
    assert times == sorted(times)


def test_two_splits_are_one_bag(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    images = [bags.poses(k) for k in range(4)]
    bags.write_bag(tmp_path / "bag/b_0.mcap", bags.camera(images=images[:2]))
    bags.write_bag(tmp_path / "bag/b_1.mcap", bags.camera(images=images[2:]))
    recording = read_bag(metadata(tmp_path / "bag", ["b_0.mcap", "b_1.mcap"]))
    assert len(recording.cameras[0].stamps) == 4


def test_images_without_a_stamp_are_counted_and_left_out(tmp_path: Path) -> None:
    unstamped = [bags.poses(k, header=bags.header(0)) for k in range(2)]
    images = [*unstamped, *(bags.poses(k) for k in range(2, 6))]
    path = bags.write_bag(tmp_path / "a.mcap", bags.camera(images=images))
    warnings: list[str] = []
    recording = read_bag(path, warn=warnings.append)
    assert len(recording.cameras[0].stamps) == 4
    assert warnings == [
        "/cam0/person_poses: 2 of 6 images are left out: their header stamp is zero"
    ]


def test_a_camera_that_does_not_stamp_does_not_take_the_others_along(tmp_path: Path) -> None:
    unstamped = [bags.poses(k, header=bags.header(0)) for k in range(3)]
    messages = [*bags.camera("cam0"), *bags.camera("cam1", unstamped), *bags.camera("cam2")]
    warnings: list[str] = []
    recording = read_bag(bags.write_bag(tmp_path / "a.mcap", messages), warn=warnings.append)
    assert [c.name for c in recording.cameras] == ["cam0", "cam2"]
    assert any("/cam1/person_poses: header stamp is zero in 3 of 3" in line for line in warnings)


def test_views_and_computed_columns_are_not_read(tmp_path: Path) -> None:
    """They can be of any size in a file of some kilobytes."""
    path = tmp_path / "a.db3"
    with closing(sqlite3.connect(path)) as base:
        base.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp,"
            " data GENERATED ALWAYS AS (zeroblob(900000000)));"
        )
    with pytest.raises(InputError, match=r"table 'messages' has no data"):
        read_bag(path)
    with closing(sqlite3.connect(path)) as base:
        base.executescript(
            "DROP TABLE messages; CREATE VIEW messages AS WITH RECURSIVE n(id) AS"
            " (SELECT 1 UNION ALL SELECT id + 1 FROM n)"
            " SELECT id, 1 AS topic_id, id AS timestamp, zeroblob(9) AS data FROM n;"
        )
    with pytest.raises(InputError, match=r"table 'messages' has no data, id"):
        read_bag(path)
