"""Topics and messages of an MCAP file, with bounded memory."""

from __future__ import annotations

import heapq
import io
import struct
import zlib
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.summary import Summary

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.bag_records import RawMessage, TopicSchema
from stcalib_ros.io.limits import (
    FREE_CHUNK_BYTES,
    FREE_POSE_BYTES,
    MAX_CHUNK_BYTES,
    MAX_EXPANSION,
    MAX_POSE_EXPANSION,
)
from stcalib_ros.io.unpacking import Budget, unpacked_chunk

MCAP_MAGIC = b"\x89MCAP0\r\n"

_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")


class McapSource:
    """An MCAP file.

    Parameters
    ----------
    path : Path
        Where it is.
    name : Path
        How to call it in messages.

    Raises
    ------
    InputError
        The file is cut off (here), or unpacks to more than can be (in every method). What the
        parser or a decompressor says about damaged bytes is left to the caller.
    """

    def __init__(self, path: Path, name: Path) -> None:
        self._name = name
        self._file = _ClampedFile(path)
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        with ExitStack() as on_failure:
            on_failure.callback(self._file.close)
            self._require_end()
            self._summary = SeekingReader(self._file).get_summary() or Summary()
            on_failure.pop_all()
        self._schemas |= self._summary.schemas
        self._channels |= self._summary.channels

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def topics(self) -> Iterator[TopicSchema]:
        """Topics, each with its definition."""
        if not self._channels:
            for _ in self._scanned(frozenset()):
                pass
        for channel in self._channels.values():
            schema = self._schemas.get(channel.schema_id)
            if schema is None:
                yield TopicSchema(channel.topic, "", channel.message_encoding, "", b"")
            else:
                yield TopicSchema(
                    channel.topic,
                    schema.name,
                    channel.message_encoding,
                    schema.encoding,
                    schema.data,
                )

    def messages(self, topics: frozenset[str], *, in_time: bool) -> Iterator[RawMessage]:
        """Messages of some topics, as they are in the file or by log time.

        By the index where there is one, else from front to back.
        """
        size = self._file.size
        budget = Budget(
            FREE_POSE_BYTES + MAX_POSE_EXPANSION * size,
            f"the poses of {self._name}",
            "the file is damaged or made to do harm",
        )
        indexed = bool(self._channels) and bool(self._summary.chunk_indexes)
        found = self._indexed(topics, in_time) if indexed else self._scanned(topics)
        if in_time and not indexed:
            found = iter(sorted(found, key=lambda message: message.log_time))
        for message in found:
            budget.take(len(message.data) + _RECORD.size + _MESSAGE.size)
            yield message

    def _indexed(self, topics: frozenset[str], in_time: bool) -> Iterator[RawMessage]:
        """Chunk by chunk; by log time, messages wait until no later chunk can precede them."""
        key = _begin if in_time else _place
        waiting: list[tuple[int, int, RawMessage]] = []
        count, chunks = 0, _ChunkBudget(self._name, self._file.size)
        for index in sorted(_distinct(self._summary), key=key):
            if not self._may_have(index, topics):
                continue
            raw = chunks.unpacked(self._chunk_at(index))
            found = self._in_chunk(raw, topics)
            if not in_time:
                yield from found
                continue
            while waiting and waiting[0][0] < index.message_start_time:
                yield heapq.heappop(waiting)[2]
            for message in found:
                count += 1
                heapq.heappush(waiting, (message.log_time, count, message))
        while waiting:
            yield heapq.heappop(waiting)[2]

    def _may_have(self, index: ChunkIndex, topics: frozenset[str]) -> bool:
        """Whether a chunk may have messages of the topics, by its index."""
        ids = index.message_index_offsets
        channels = [self._channels.get(i) for i in ids]
        return not ids or any(c is None or c.topic in topics for c in channels)

    def _chunk_at(self, index: ChunkIndex) -> Chunk:
        self._file.seek(index.chunk_start_offset)
        opcode, _ = _RECORD.unpack(self._file.read(_RECORD.size))
        if opcode != Opcode.CHUNK:
            raise ValueError(
                f"the index lists a chunk at {index.chunk_start_offset} that is not there"
            )
        chunk: Chunk = Chunk.read(ReadDataStream(self._file))
        return chunk

    def _scanned(self, topics: frozenset[str]) -> Iterator[RawMessage]:
        """From front to back; takes in the channels on the way."""
        self._file.seek(0)
        chunks = _ChunkBudget(self._name, self._file.size)
        reader = StreamReader(
            self._file, emit_chunks=True, validate_crcs=True, record_size_limit=MAX_CHUNK_BYTES
        )
        for record in reader.records:
            if isinstance(record, Schema):
                self._schemas[record.id] = record
            elif isinstance(record, Channel):
                self._channels[record.id] = record
            elif isinstance(record, Chunk):
                yield from self._in_chunk(chunks.unpacked(record), topics)
            elif isinstance(record, Message):
                yield from self._chosen(record.channel_id, record.log_time, record.data, topics)

    def _in_chunk(self, raw: bytes, topics: frozenset[str]) -> Iterator[RawMessage]:
        """Messages in an unpacked chunk; one at a time, so that many tiny ones take no memory."""
        at = 0
        while at < len(raw):
            opcode, length = _RECORD.unpack_from(raw, at)
            at += _RECORD.size
            if length > len(raw) - at:
                raise ValueError(f"a record of {length} bytes does not fit into its chunk")
            if opcode == Opcode.MESSAGE:
                channel, _, log_time, _ = _MESSAGE.unpack_from(raw, at)
                data = raw[at + _MESSAGE.size : at + length]
                yield from self._chosen(channel, log_time, data, topics)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._define(opcode, raw[at : at + length])
            at += length

    def _define(self, opcode: int, record: bytes) -> None:
        stream = ReadDataStream(io.BytesIO(record))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            self._schemas[schema.id] = schema
        else:
            channel = Channel.read(stream)
            self._channels[channel.id] = channel

    def _chosen(
        self, channel_id: int, log_time: int, data: bytes, topics: frozenset[str]
    ) -> Iterator[RawMessage]:
        channel = self._channels.get(channel_id)
        if channel is None or channel.topic not in topics:
            return
        schema = self._schemas.get(channel.schema_id)
        if schema is not None:
            fraction = self._file.tell() / self._file.size
            yield RawMessage(channel.topic, schema.name, log_time, data, fraction)

    def _require_end(self) -> None:
        """Demand the end that a recorder writes last."""
        self._file.seek(-min(len(MCAP_MAGIC), self._file.size), 2)
        if self._file.read() != MCAP_MAGIC or self._file.size <= len(MCAP_MAGIC):
            raise InputError(
                f"{self._name} is truncated: the recording was cut off before its end was written; "
                f"`mcap recover {self._name} -o recovered.mcap` saves what can be read"
            )
        self._file.seek(0)


class _ClampedFile(io.BufferedReader):
    """A file that never makes room for more bytes than it has, whatever a length in it says."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self.size = path.stat().st_size

    def read(self, size: int | None = -1, /) -> bytes:
        left = max(self.size - self.tell(), 0)
        return super().read(left if size is None or size < 0 else min(size, left))


class _ChunkBudget:
    """Unpacks the chunks of a file up to a limit."""

    def __init__(self, name: Path, size: int) -> None:
        self._name = name
        self._remedy = (
            f"`mcap filter {name} -o poses.mcap -y '.*/(person_poses|camera_info)'` makes a bag of "
            "what is needed"
        )
        limit = FREE_CHUNK_BYTES + MAX_EXPANSION * size
        self._budget = Budget(limit, f"the chunks of {name}", self._remedy)

    def unpacked(self, chunk: Chunk) -> bytes:
        """Unpacked records of a chunk."""
        size = chunk.uncompressed_size
        if size > MAX_CHUNK_BYTES:
            raise InputError(
                f"{self._name} has a chunk of {size / 1e6:.0f} MB, which is more than the "
                f"{MAX_CHUNK_BYTES / 1e6:.0f} MB that are unpacked at once; {self._remedy}"
            )
        self._budget.take(size)
        raw = unpacked_chunk(chunk.compression, chunk.data, size)
        if chunk.uncompressed_crc not in (0, zlib.crc32(raw)):
            raise ValueError("the checksum of a chunk does not match its content")
        return raw


def _distinct(summary: Summary) -> list[ChunkIndex]:
    """Index of every chunk once, however often it is listed."""
    return list({index.chunk_start_offset: index for index in summary.chunk_indexes}.values())


def _begin(index: ChunkIndex) -> int:
    return index.message_start_time


def _place(index: ChunkIndex) -> int:
    return index.chunk_start_offset
