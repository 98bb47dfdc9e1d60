"""Decompression that a small file cannot make large: every call has a limit."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]
import zstandard

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.limits import FREE_FILE_BYTES, MAX_FILE_EXPANSION, MAX_MESSAGE_BYTES

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_COPY_BYTES = 1 << 20


class Budget:
    """So many bytes and no more.

    Parameters
    ----------
    limit : int
        Bytes.
    what : str
        What takes them, for the message: "the chunks of walk.mcap".
    remedy : str
        What to do instead.
    """

    def __init__(self, limit: int, what: str, remedy: str) -> None:
        self._limit = self.left = limit
        self._what, self._remedy = what, remedy

    def take(self, n_bytes: int) -> None:
        """Take some of them.

        Raises
        ------
        InputError
            There are not as many left.
        """
        self.left -= n_bytes
        if self.left < 0:
            raise InputError(
                f"{self._what} unpack to more than {self._limit / 1e6:.0f} MB, as no recording of "
                f"poses does; {self._remedy}"
            )


def unpacked_chunk(compression: str, data: bytes, size: int) -> bytes:
    """Unpack a chunk of an MCAP file.

    Parameters
    ----------
    compression : str
        ``zstd``, ``lz4``, or empty.
    data : bytes
    size : int
        Of the unpacked chunk, as the file says.

    Raises
    ------
    ValueError, RuntimeError, zstandard.ZstdError
        The data are damaged, or the size is another one.
    """
    if compression == "zstd":
        raw = _zstd(data, size)
    elif compression == "lz4":
        raw = bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1))
    elif compression:
        raise ValueError(f"unknown compression {compression!r}")
    else:
        raw = data
    if len(raw) != size:
        raise ValueError(f"a chunk of {size} bytes unpacks to {len(raw)} or more")
    return raw


def unpacked_message(data: bytes) -> bytes:
    """Unpack a message of ``--compression-mode message``; others stay as they are.

    Plain CDR begins with a zero, so that no message can be mistaken for a packed one.

    Raises
    ------
    ValueError, zstandard.ZstdError
        The data are damaged, or would become longer than messages of poses are.
    """
    return _zstd(data, MAX_MESSAGE_BYTES) if data.startswith(ZSTD_MAGIC) else data


@contextmanager
def unpacked_file(path: Path) -> Iterator[Path]:
    """Path of an unpacked copy of a ``.zstd`` file, which is there as long as the block runs.

    Other files are their own copy.

    Raises
    ------
    InputError
        The content is absurdly larger than the file, or the disk is full.
    """
    with path.open("rb") as packed:
        is_packed = packed.read(len(ZSTD_MAGIC)) == ZSTD_MAGIC
        if not is_packed:
            yield path
            return
        packed.seek(0)
        limit = FREE_FILE_BYTES + MAX_FILE_EXPANSION * path.stat().st_size
        budget = Budget(
            limit, f"the contents of {path}", f"`unzstd {path}` unpacks it all the same"
        )
        with tempfile.NamedTemporaryFile(suffix=Path(path.stem).suffix) as copy:
            reader = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
            while block := reader.read(_COPY_BYTES):
                budget.take(len(block))
                copy.write(block)
            copy.flush()
            yield Path(copy.name)


def _zstd(data: bytes, limit: int) -> bytes:
    size = zstandard.frame_content_size(data)
    if size > limit:
        raise ValueError(f"{len(data)} bytes unpack to {size}, more than {limit}")
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=limit)
