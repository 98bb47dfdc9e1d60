"""Topics and raw messages of a bag, whatever its files are: MCAP or SQLite, packed or not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from stcalib_ros.core.errors import InputError, StcalibError
from stcalib_ros.io.bag_records import RawMessage, TopicSchema
from stcalib_ros.io.limits import MAX_QUOTED
from stcalib_ros.io.mcap_source import MCAP_MAGIC, McapSource
from stcalib_ros.io.sqlite_source import SQLITE_MAGIC, SqliteSource
from stcalib_ros.io.unpacking import unpacked_file, unpacked_message

_ROS1 = b"#ROSBAG V"
_PACKED = (b"PK\x03\x04", b"\x1f\x8b", b"BZh", b"\xfd7zXZ", b"7z\xbc\xaf")
"""Begin of zip, gzip, bzip2, xz and 7z files."""


def topic_schemas(files: Sequence[Path]) -> tuple[TopicSchema, ...]:
    """Topics of all files; one entry for every definition that a topic occurs with.

    Raises
    ------
    InputError
        A file is empty, cut off, damaged or no bag.
    """
    found: dict[TopicSchema, None] = {}
    for path in files:
        with _opened(path) as source:
            found.update(dict.fromkeys(source.topics()))
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
        with _opened(path) as source:
            for topic, kind, log_time, data, fraction in source.messages(topics, in_time=in_time):
                read = (before + fraction * size) / total
                yield RawMessage(topic, kind, log_time, unpacked_message(data), read)
        before += size


def one_line(error: Exception) -> str:
    """Type and text of an error that others made, as one line: it may quote what it read.

    Examples
    --------
    >>> one_line(ValueError(" no such   thing"))
    'ValueError: no such thing'
    """
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text[:MAX_QUOTED]}"


@contextmanager
def _opened(path: Path) -> Iterator[McapSource | SqliteSource]:
    """Open a file by what it begins with; what goes wrong inside is an InputError."""
    recover = ""
    try:
        with unpacked_file(path) as unpacked:
            kind, recover = _kind_of(path, unpacked)
            with closing(kind(unpacked, path)) as source:
                yield source
    except StcalibError:
        raise
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except Exception as error:  # whatever a parser or a decompressor says about damaged bytes
        raise InputError(f"{path} is damaged ({one_line(error)}){recover}") from error


def _kind_of(path: Path, unpacked: Path) -> tuple[type[McapSource | SqliteSource], str]:
    """Reader of a file, and how to save what can be read of a damaged one."""
    with unpacked.open("rb") as stream:
        head = stream.read(len(SQLITE_MAGIC))
    if not head:
        raise InputError(f"{path} is empty (0 bytes): nothing was recorded")
    if head.startswith(SQLITE_MAGIC):
        return SqliteSource, (
            f"; `sqlite3 {path} .recover | sqlite3 recovered.db3` saves what can be read"
        )
    if MCAP_MAGIC.startswith(head[: len(MCAP_MAGIC)]):
        return McapSource, f"; `mcap recover {path} -o recovered.mcap` saves what can be read"
    if head.startswith(_ROS1):
        raise InputError(
            f"{path} is a ROS 1 bag; `rosbags-convert --src {path} --dst {path.stem}` (of the "
            "package rosbags) makes a ROS 2 bag of it"
        )
    if head.startswith(_PACKED):
        raise InputError(f"{path} is packed: unpack it, and name the bag in it")
    raise InputError(
        f"{path} is not a bag: it begins with {head[:8]!r}; `stcalib convert` makes a bag of poses "
        "in the files of other programs"
    )
