"""The files of a bag, and the raw messages in them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, NamedTuple

from mcap.reader import McapReader, NonSeekingReader, make_reader
from mcap.records import Channel, Schema
from mcap.stream_reader import StreamReader

from stcalib_ros.core.errors import InputError, StcalibError
from stcalib_ros.io.yaml_files import read_yaml

_MAGIC = b"\x89MCAP0\r\n"
_SQLITE = b"SQLite format 3"
_INFO = "rosbag2_bagfile_information"
_TO_MCAP = "`ros2 bag convert` turns it into an MCAP bag"


@dataclass(frozen=True, slots=True)
class TopicSchema:
    """A topic of a bag and the definition of its messages."""

    topic: str
    type_name: str
    encoding: str
    schema_encoding: str
    schema: bytes


class RawMessage(NamedTuple):
    """A message as it is in the bag, and how much of the bag has been read with it, 0..1."""

    topic: str
    type_name: str
    log_time: int
    data: bytes
    fraction: float


def bag_files(path: Path) -> tuple[Path, ...]:
    """MCAP files of a bag, in order: the file itself, or those of a rosbag2 folder.

    Raises
    ------
    InputError
        There is no such bag, or it is stored in another way.
    """
    if not path.exists():
        raise InputError(f"no such bag: {path}")
    if not path.is_dir():
        return (path,)
    metadata = path / "metadata.yaml"
    if metadata.exists():
        return _listed_files(path, metadata)
    files = tuple(sorted(path.glob("*.mcap"), key=lambda p: (len(p.name), p.name)))
    if not files:
        others = sorted(p.name for p in path.iterdir())
        raise InputError(
            f"{path} is not a bag: it has neither metadata.yaml nor .mcap files, but "
            f"{', '.join(others[:5]) or 'nothing'}"
        )
    return files


def topic_schemas(files: Sequence[Path]) -> tuple[TopicSchema, ...]:
    """Topics of all files; one entry for every definition that a topic occurs with.

    Raises
    ------
    InputError
        A file is empty, cut off, damaged or not an MCAP file.
    """
    found: dict[TopicSchema, None] = {}
    for path in files:
        with _opened(path) as stream:
            reader = make_reader(stream)
            summary = reader.get_summary()
            if summary is not None and summary.channels:
                pairs = [(c, summary.schemas.get(c.schema_id)) for c in summary.channels.values()]
            else:
                pairs = list(_scanned_channels(stream))
            found.update(dict.fromkeys(_topic_schema(c, s) for c, s in pairs))
    return tuple(found)


def raw_messages(
    files: Sequence[Path],
    topics: frozenset[str],
    *,
    in_time: bool = False,
) -> Iterator[RawMessage]:
    """Messages of the given topics, in the order of the files.

    Parameters
    ----------
    files : sequence of Path
    topics : frozenset of str
    in_time : bool
        Within each file in the order in which they were logged, which takes longer.

    Raises
    ------
    InputError
        A file is damaged.
    """
    sizes = [path.stat().st_size for path in files]
    total, before = max(sum(sizes), 1), 0
    for path, size in zip(files, sizes, strict=True):
        with _opened(path) as stream:
            reader = _message_reader(stream)
            for schema, channel, message in reader.iter_messages(topics, log_time_order=in_time):
                if schema is not None:
                    fraction = (before + stream.tell()) / total
                    yield RawMessage(
                        channel.topic, schema.name, message.log_time, message.data, fraction
                    )
        before += size


def _message_reader(stream: IO[bytes]) -> McapReader:
    """By the index where there is one; else from front to back."""
    reader = make_reader(stream, validate_crcs=True)
    summary = reader.get_summary()
    if summary is not None and summary.channels and summary.chunk_indexes:
        return reader
    stream.seek(0)
    return NonSeekingReader(stream, validate_crcs=True)


def _scanned_channels(stream: IO[bytes]) -> Iterator[tuple[Channel, Schema | None]]:
    stream.seek(0)
    schemas: dict[int, Schema] = {}
    for record in StreamReader(stream).records:
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            yield record, schemas.get(record.schema_id)


def _topic_schema(channel: Channel, schema: Schema | None) -> TopicSchema:
    if schema is None:
        return TopicSchema(channel.topic, "", channel.message_encoding, "", b"")
    return TopicSchema(
        channel.topic, schema.name, channel.message_encoding, schema.encoding, schema.data
    )


@contextmanager
def _opened(path: Path) -> Iterator[IO[bytes]]:
    """Open an MCAP file that begins and ends as one; what goes wrong inside is an InputError."""
    try:
        with path.open("rb") as stream:
            _require_mcap(path, stream)
            yield stream
    except StcalibError:
        raise
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except Exception as error:  # whatever the parser or a decompressor says about damaged bytes
        raise InputError(
            f"{path} is damaged ({type(error).__name__}: {error}); "
            f"`mcap recover {path} -o recovered.mcap` saves what can be read"
        ) from error


def _require_mcap(path: Path, stream: IO[bytes]) -> None:
    head = stream.read(len(_SQLITE))
    if not head:
        raise InputError(f"{path} is empty (0 bytes): nothing was recorded")
    if head.startswith(_SQLITE):
        raise InputError(f"{path} is an SQLite bag; {_TO_MCAP}")
    if not _MAGIC.startswith(head[: len(_MAGIC)]):
        raise InputError(f"{path} is not an MCAP file: it begins with {head[:8]!r}")
    stream.seek(-min(len(_MAGIC), stream.seek(0, 2)), 2)
    size = stream.tell() + len(_MAGIC)
    if stream.read() != _MAGIC or size <= len(_MAGIC):
        raise InputError(
            f"{path} is truncated: the recording was cut off before its end was written; "
            f"`mcap recover {path} -o recovered.mcap` saves what can be read"
        )
    stream.seek(0)


def _listed_files(folder: Path, metadata: Path) -> tuple[Path, ...]:
    info = _bag_information(metadata)
    storage = info.get("storage_identifier")
    if storage != "mcap":
        raise InputError(f"{folder}: storage is {storage!r}, not 'mcap'; {_TO_MCAP}")
    if mode := str(info.get("compression_mode") or "").lower():
        raise InputError(
            f"{folder}: compression mode {mode!r} is not read, only compressed chunks; {_TO_MCAP}"
        )
    names = info.get("relative_file_paths")
    if not isinstance(names, list) or not names:
        raise InputError(f"{metadata}: relative_file_paths lists no file")
    files = tuple(folder / str(name) for name in names)
    if missing := [str(f) for f in files if not f.exists()]:
        raise InputError(f"{metadata} lists files that are not there: {', '.join(missing)}")
    return files


def _bag_information(metadata: Path) -> Mapping[str, Any]:
    content = read_yaml(metadata)
    info = content.get(_INFO) if isinstance(content, Mapping) else None
    if not isinstance(info, Mapping):
        raise InputError(f"{metadata} is not rosbag2 metadata: it has no {_INFO}")
    return info
