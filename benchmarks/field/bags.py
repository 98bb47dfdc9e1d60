"""Kind H: bags as other programs leave them."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from benchmarks.field.case import SOUND, Case, Member, simulated
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.synthetic import SceneOptions
from stcalib_ros.io.bag_writer import write_bag

_ZERO_STAMPS = 2
"""Images at the beginning that are stamped before there was a clock."""


def _base(seed: int) -> Case:
    return simulated(SceneOptions(seed=24_000 + seed))


def _plain(recording: Recording, folder: Path) -> Path:
    path = folder / "walk.mcap"
    write_bag(recording, path)
    return path


def _metadata(folder: Path, files: list[str], storage: str) -> None:
    information = {
        "version": 5,
        "storage_identifier": storage,
        "relative_file_paths": files,
        "duration": {"nanoseconds": 10**10},
        "starting_time": {"nanoseconds_since_epoch": 0},
        "message_count": 0,
        "topics_with_message_count": [],
        "compression_format": "",
        "compression_mode": "",
    }
    text = yaml.safe_dump({"rosbag2_bagfile_information": information})
    (folder / "metadata.yaml").write_text(text)


def _sqlite(recording: Recording, folder: Path) -> Path:
    """Write what Humble records by default: an SQLite file, without definitions."""
    bag = folder / "walk"
    bag.mkdir()
    with sqlite3.connect(bag / "walk_0.db3") as base, _plain(recording, folder).open("rb") as mcap:
        base.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
            "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)"
        )
        base.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
            "timestamp INTEGER NOT NULL, data BLOB NOT NULL)"
        )
        topics: dict[str, int] = {}
        for schema, channel, message in make_reader(mcap).iter_messages():
            assert schema is not None
            if channel.topic not in topics:
                topics[channel.topic] = len(topics) + 1
                row = (topics[channel.topic], channel.topic, schema.name, "cdr", "")
                base.execute("INSERT INTO topics VALUES (?, ?, ?, ?, ?)", row)
            values = (topics[channel.topic], message.log_time, message.data)
            base.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", values)
    base.close()
    _metadata(bag, ["walk_0.db3"], "sqlite3")
    return bag


def _reindexed(recording: Recording, folder: Path) -> Path:
    """Leave the name of the storage empty, as ``ros2 bag reindex`` does."""
    bag = folder / "walk"
    bag.mkdir()
    _plain(recording, folder).rename(bag / "walk_0.mcap")
    _metadata(bag, ["walk_0.mcap"], "")
    return bag


def _killed(recording: Recording, folder: Path) -> Path:
    """Let the last split be empty, as a killed recorder leaves it."""
    bag = folder / "walk"
    bag.mkdir()
    _plain(recording, folder).rename(bag / "walk_0.mcap")
    (bag / "walk_1.mcap").touch()
    _metadata(bag, ["walk_0.mcap", "walk_1.mcap"], "mcap")
    return bag


def _rewritten(
    recording: Recording,
    folder: Path,
    *,
    definition: Callable[[Any], tuple[str, bytes]] = lambda schema: (schema.encoding, schema.data),
    data: Callable[[str, int, bytes], bytes] = lambda _topic, _n, message: message,
) -> Path:
    """Write the bag again with other definitions or messages (by topic and number)."""
    out = folder / "again.mcap"
    with _plain(recording, folder).open("rb") as source, out.open("wb") as target:
        writer = Writer(target, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="")
        channels: dict[int, int] = {}
        counts: dict[str, int] = {}
        for schema, channel, message in make_reader(source).iter_messages():
            assert schema is not None
            if channel.id not in channels:
                known = writer.register_schema(schema.name, *definition(schema))
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, known
                )
            counts[channel.topic] = n = counts.get(channel.topic, -1) + 1
            changed = data(channel.topic, n, message.data)
            writer.add_message(
                channels[channel.id], message.log_time, changed, message.publish_time
            )
        writer.finish()
    return out


def _undefined(recording: Recording, folder: Path) -> Path:
    return _rewritten(recording, folder, definition=lambda _: ("", b""))


def _idl(recording: Recording, folder: Path) -> Path:
    def definition(schema: Any) -> tuple[str, bytes]:
        return "ros2idl", f"IDL: {schema.name}\nmodule m {{ struct S {{ long x; }}; }};".encode()

    return _rewritten(recording, folder, definition=definition)


def _unstamped(recording: Recording, folder: Path) -> Path:
    """Set the stamps of the first images to zero: there was no clock yet."""

    def data(topic: str, n: int, message: bytes) -> bytes:
        early = topic.endswith("person_poses") and n < _ZERO_STAMPS
        return message[:4] + bytes(8) + message[12:] if early else message

    return _rewritten(recording, folder, data=data)


def _padded(seed: int) -> Case:
    """Let plumb_bob have eight coefficients, the last three of them zero."""
    case = _base(seed)
    cameras = tuple(
        replace(camera, intrinsics=replace(camera.intrinsics, D=np.zeros(8)))
        for camera in case.recording.cameras
    )
    return replace(case, recording=replace(case.recording, cameras=cameras))


BAGS = (
    Member("H", "SQLite", _base, SOUND, _sqlite),
    Member("H", "no name of a storage", _base, SOUND, _reindexed),
    Member("H", "empty last split", _base, SOUND, _killed),
    Member("H", "no definitions", _base, SOUND, _undefined),
    Member("H", "definitions as IDL", _base, SOUND, _idl),
    Member("H", "first stamps zero", _base, SOUND, _unstamped),
    Member("H", "eight coefficients of plumb_bob", _padded, SOUND),
)
