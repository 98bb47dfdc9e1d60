"""What an MP4 or QuickTime film says of itself: when it was made, and whether it is all there."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

_EPOCH_S = 2_082_844_800
"""Seconds from 1904, from which QuickTime counts, to 1970: ISO/IEC 14496-12, 8.2.2."""
_EARLIEST_S = 946_684_800
"""Unix seconds, 2000-01-01: a film that was made before has a clock that nobody has set. Chosen."""
_MAX_MOOV_BYTES = 1 << 26
"""Bytes. A longer table of contents is not looked at: one of three hours at 60 Hz has 10 MB.
Chosen."""
_FIRST = (b"ftyp", b"moov", b"wide", b"mdat")
"""Names of boxes with which such films begin."""
_LONG_SIZE = 1
"""Size of a box that says that 64 bits with its size follow its name: ISO/IEC 14496-12, 4.2."""
_ENDS_AT_STOP = b"com.android.version"
"""In films of Android's recorder, which writes the time at which it stops."""


@dataclass(frozen=True, slots=True)
class FilmHeader:
    """What is not needed to decode a film.

    Attributes
    ----------
    made_s : float or None
        Unix time at which the film begins, to a whole second; None where it does not say.
    duration_s : float or None
        How long it is shown; None where it does not say.
    missing_bytes : int
        What is missing at its end by the sizes in it: the file is cut off, or still being written.
    """

    made_s: float | None = None
    duration_s: float | None = None
    missing_bytes: int = 0


def read_film_header(path: Path) -> FilmHeader:
    """Read the header of a film; empty for what is neither MP4 nor QuickTime.

    Android writes the time at which a film ends: its duration is taken off.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    size, found, missing = path.stat().st_size, FilmHeader(), 0
    with path.open("rb") as stream:
        for name, start, end in _boxes(stream, size):
            missing = max(missing, end - size)
            if name == b"moov" and end - start < _MAX_MOOV_BYTES:
                stream.seek(start)
                found = _header_of(stream.read(end - start))
    return replace(found, missing_bytes=missing)


def _boxes(stream: BinaryIO, size: int) -> Iterator[tuple[bytes, int, int]]:
    """Yield name, begin of the content and end of every box; none of a file of another kind."""
    at = 0
    while at < size:
        stream.seek(at)
        head = stream.read(8)
        if len(head) < len(b"SIZENAME") or (
            at == 0 and head[4:] not in (b"ftyp", b"moov", b"wide")
        ):
            return
        length, name = struct.unpack(">I4s", head)
        start = at + len(head)
        if length == _LONG_SIZE:
            long = stream.read(8)
            if len(long) < len(head):
                return
            (length,) = struct.unpack(">Q", long)
            start += len(long)
        end = size if length == 0 else at + length
        if end < start:
            return
        yield name, start, end
        at = end


def _header_of(moov: bytes) -> FilmHeader:
    """Return begin and duration of a film by the box ``mvhd`` of its table of contents."""
    at = moov.find(b"mvhd") + 4
    version = moov[at : at + 1]
    form = ">QQIQ" if version == b"\x01" else ">IIII"
    fields = moov[at + 4 : at + 4 + struct.calcsize(form)]
    if version not in (b"\x00", b"\x01") or len(fields) < struct.calcsize(form):
        return FilmHeader()
    made, _, ticks_hz, ticks = struct.unpack(form, fields)
    duration_s = ticks / ticks_hz if ticks_hz else 0.0
    made_s = float(made - _EPOCH_S) - (duration_s if _ENDS_AT_STOP in moov else 0.0)
    return FilmHeader(made_s if made_s >= _EARLIEST_S else None, duration_s or None)
