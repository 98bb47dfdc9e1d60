from __future__ import annotations

import contextlib
import struct

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from stcalib_ros.io.cdr import CdrReader, CdrWriter
from stcalib_ros.io.message_types import CAMERA_INFO, PERSON_POSES, decode

KINDS = {
    "boolean": st.booleans(),
    "int32": st.integers(-(2**31), 2**31 - 1),
    "uint32": st.integers(0, 2**32 - 1),
    "float32": st.floats(width=32, allow_nan=False),
    "string": st.text("aZ_/ ä日", max_size=5),
    "strings": st.lists(st.sampled_from(["", "a", "left_knee"]), max_size=3),
    "float32s": st.lists(st.floats(width=32, allow_nan=False), max_size=4),
    "float64s": st.lists(st.floats(allow_nan=False), max_size=4),
}


@given(st.lists(st.sampled_from(sorted(KINDS)).flatmap(lambda k: st.tuples(st.just(k), KINDS[k]))))
def test_what_is_written_is_read(fields: list[tuple[str, object]]) -> None:
    writer = CdrWriter()
    for kind, value in fields:
        getattr(writer, kind)(value)
    reader = CdrReader(writer.data())
    for kind, value in fields:
        read = getattr(reader, kind)()
        assert (read.tolist() if isinstance(read, np.ndarray) else read) == value


def test_either_endianness() -> None:
    little = b"\x00\x01\x00\x00" + struct.pack("<B3xI4x2d", 1, 2, 0.5, -1.0)
    big = b"\x00\x00\x00\x00" + struct.pack(">B3xI4x2d", 1, 2, 0.5, -1.0)
    # Doubles stand at multiples of eight bytes after the header: no filling is needed here.
    for data in (little[:12] + little[16:], big[:12] + big[16:]):
        reader = CdrReader(data)
        assert reader.boolean() is True
        assert reader.uint32() == 2
        assert reader.float64s(2).tolist() == [0.5, -1.0]


@pytest.mark.parametrize("data", [b"", b"\x00\x01", b"\x00\x07\x00\x00abcd", b"abcdefgh"])
def test_no_cdr(data: bytes) -> None:
    with pytest.raises(ValueError, match="not plain CDR"):
        CdrReader(data)


@pytest.mark.parametrize("kind", [PERSON_POSES.name, CAMERA_INFO.name])
@given(data=st.binary(max_size=300))
def test_any_bytes_give_a_message_or_an_error(kind: str, data: bytes) -> None:
    with contextlib.suppress(ValueError, struct.error):
        decode(kind, b"\x00\x01\x00\x00" + data)
