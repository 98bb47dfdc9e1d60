"""Topics and messages of an SQLite file of rosbag2, with Python's own ``sqlite3``."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from urllib.parse import quote

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.bag_records import RawMessage, TopicSchema

SQLITE_MAGIC = b"SQLite format 3"

_COLUMNS: Mapping[str, frozenset[str]] = {
    "topics": frozenset({"id", "name", "type", "serialization_format"}),
    "messages": frozenset({"id", "topic_id", "timestamp", "data"}),
}
"""What is read of the tables; all releases of rosbag2 have these."""
_DEFINITIONS = "message_definitions"
"""Table of ROS 2 Iron and newer."""


class SqliteSource:
    """An SQLite file.

    Parameters
    ----------
    path : Path
        Where it is.
    name : Path
        How to call it in messages.

    Raises
    ------
    InputError
        The tables are not those of rosbag2. What SQLite says about damaged files is left to the
        caller.
    """

    def __init__(self, path: Path, name: Path) -> None:
        # A log beside the file has messages that the file has not; without one, nothing is written.
        mode = "mode=ro" if path.with_name(f"{path.name}-wal").exists() else "immutable=1"
        uri = f"file:{quote(str(path.absolute()))}?{mode}"
        self._base = sqlite3.connect(uri, uri=True, check_same_thread=False)
        with ExitStack() as on_failure:
            on_failure.callback(self._base.close)
            self._tables = self._tables_of(name)
            on_failure.pop_all()

    def close(self) -> None:
        """Close the file."""
        self._base.close()

    def topics(self) -> Iterator[TopicSchema]:
        """Topics, each with its definition where the file has one."""
        texts: dict[str, tuple[str, str]] = {}
        if _DEFINITIONS in self._tables:
            rows = self._base.execute(
                f"SELECT topic_type, encoding, encoded_message_definition FROM {_DEFINITIONS}"
            )
            texts = {str(kind): (str(encoding), str(text)) for kind, encoding, text in rows}
        for name, kind, encoding in self._base.execute(
            "SELECT name, type, serialization_format FROM topics ORDER BY id"
        ):
            schema_encoding, text = texts.get(str(kind), ("", ""))
            yield TopicSchema(str(name), str(kind), str(encoding), schema_encoding, text.encode())

    def messages(self, topics: frozenset[str], *, in_time: bool) -> Iterator[RawMessage]:
        """Messages of some topics, as they are in the file or by log time."""
        known = self._base.execute("SELECT id, name, type FROM topics").fetchall()
        wanted = {int(i): (str(name), str(kind)) for i, name, kind in known if name in topics}
        (last,) = self._base.execute("SELECT max(id) FROM messages").fetchone()
        rows = self._base.execute(
            f"SELECT id, topic_id, timestamp, data FROM messages WHERE topic_id IN "
            f"({', '.join(map(str, wanted))}) ORDER BY {'timestamp, id' if in_time else 'id'}"
        )
        for number, topic, log_time, data in rows:
            if not isinstance(data, bytes):
                raise ValueError(f"message {number} is not a sequence of bytes")
            fraction = min(max(number / max(last, 1), 0.0), 1.0)
            yield RawMessage(*wanted[topic], int(log_time), data, fraction)

    def _tables_of(self, name: Path) -> set[str]:
        """Tables; views and computed columns, which may be of any size, are none."""
        rows = self._base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
        tables = {str(table) for (table,) in rows}
        for table, needed in _COLUMNS.items():
            info = self._base.execute(f"PRAGMA table_info({table})") if table in tables else ()
            if missing := needed - {str(column[1]) for column in info}:
                raise InputError(
                    f"{name} is an SQLite file, but no bag: table {table!r} has no "
                    f"{', '.join(sorted(missing))}"
                )
        return tables
