"""The messages of a bag in other storages and packings."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from bag_helpers import CAMERA_INFO, POSES, schema_text
from mcap.reader import make_reader
from mcap.writer import Writer

Raw = tuple[str, str, int, bytes]


def raw(bag: Path) -> list[Raw]:
    with bag.open("rb") as stream:
        return [
            (channel.topic, schema.name, message.log_time, message.data)
            for schema, channel, message in make_reader(stream).iter_messages()
            if schema is not None
        ]


def rewritten(
    source: Path,
    target: Path,
    *,
    definition: Callable[[str], tuple[str, bytes]] = lambda k: ("ros2msg", schema_text(k).encode()),
    pack: Callable[[bytes], bytes] = bytes,
    **options: object,
) -> Path:
    """Another MCAP file with the same messages."""
    with target.open("wb") as stream:
        writer = Writer(stream, **options)  # type: ignore[arg-type]
        writer.start(profile="ros2", library="test")
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        for topic, kind, log_time, data in raw(source):
            if kind not in schemas:
                schemas[kind] = writer.register_schema(kind, *definition(kind))
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "cdr", schemas[kind])
            writer.add_message(channels[topic], log_time, pack(data), log_time)
        writer.finish()
    return target


def sqlite(
    source: Path, target: Path, *, definitions: bool, pack: Callable[[bytes], bytes]
) -> Path:
    """Write an SQLite file: as Humble does, or with the definitions of Iron and newer."""
    with closing(sqlite3.connect(target)) as base:
        base.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
            " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,"
            " timestamp INTEGER NOT NULL, data BLOB NOT NULL);"
        )
        if definitions:
            base.execute(
                "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL,"
                " encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL)"
            )
            for kind in (POSES, CAMERA_INFO):
                base.execute(
                    "INSERT INTO message_definitions(topic_type, encoding,"
                    " encoded_message_definition) VALUES (?, 'ros2msg', ?)",
                    (kind, schema_text(kind)),
                )
        ids: dict[str, int] = {}
        for topic, kind, log_time, data in raw(source):
            if topic not in ids:
                ids[topic] = len(ids) + 1
                base.execute(
                    "INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')", (ids[topic], topic, kind)
                )
            base.execute(
                "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)",
                (ids[topic], log_time, pack(data)),
            )
        base.commit()
    return target
