"""Decoding of poses: whether all persons are alike or not."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stcalib_ros.io.cdr import CdrWriter
from stcalib_ros.io.message_types import PERSON_POSES, decode

Person = tuple[int, float, list[float], list[float], list[float]]

NUMBERS = st.floats(width=32, allow_nan=False)
ARRAYS = st.lists(NUMBERS, max_size=6)


def message(persons: list[Person], *, frame_id: str = "cam0") -> bytes:
    cdr = CdrWriter()
    cdr.int32(5)
    cdr.uint32(7)
    cdr.string(frame_id)
    cdr.string("h36m_17")
    cdr.strings(())
    cdr.boolean(False)
    cdr.boolean(True)
    cdr.uint32(len(persons))
    for track_id, score, *arrays in persons:
        cdr.uint32(track_id)
        cdr.float32(score)
        for values in arrays:
            cdr.float32s(values)
    return cdr.data()


def alike(sizes: tuple[int, int, int]) -> st.SearchStrategy[list[Person]]:
    arrays = [st.lists(NUMBERS, min_size=n, max_size=n) for n in sizes]
    return st.lists(st.tuples(st.integers(0, 2**32 - 1), NUMBERS, *arrays), max_size=4)


PERSONS = st.one_of(
    st.lists(st.tuples(st.integers(0, 2**32 - 1), NUMBERS, ARRAYS, ARRAYS, ARRAYS), max_size=4),
    st.tuples(*[st.integers(0, 5)] * 3).flatmap(alike),
)


@given(persons=PERSONS, frame_id=st.text("ab", max_size=4))
def test_what_is_written_is_read(persons, frame_id):
    decoded = decode(PERSON_POSES.name, message(persons, frame_id=frame_id))
    assert (decoded.header.frame_id, decoded.metric) == (frame_id, True)
    found = [
        (p.track_id, p.score, *(list(a) for a in (p.joints, p.keypoints, p.joint_scores)))
        for p in decoded.persons
    ]
    assert found == persons


@given(persons=PERSONS.filter(bool), data=st.data())
def test_a_message_that_ends_early_is_refused(persons, data):
    whole = message(persons)
    with pytest.raises((ValueError, struct.error)):
        decode(PERSON_POSES.name, whole[: data.draw(st.integers(0, len(whole) - 1))])


def test_big_endian_persons():
    words = np.array([3, 0, 1, 0, 0, 0], dtype=">u4")
    words[[1, 3]] = np.array([0.5, 2.0], dtype=">f4").view(">u4")
    head = message([])[4:-4]
    swapped = b"\x00\x00\x00\x00" + struct.pack(">iI", 5, 7)
    for text in (b"cam0\x00", b"h36m_17\x00"):
        swapped += bytes(-len(swapped) % 4) + struct.pack(">I", len(text)) + text
    swapped += bytes(-len(swapped) % 4) + struct.pack(">I", 0) + b"\x00\x01"
    swapped += bytes(-len(swapped) % 4) + struct.pack(">I", 1) + words.tobytes()
    assert len(swapped) == len(head) + 4 + 4 + words.nbytes
    (person,) = decode(PERSON_POSES.name, swapped).persons
    assert (person.track_id, person.score, list(person.joints)) == (3, 0.5, [2.0])


def test_more_persons_than_the_message_can_hold_are_refused():
    data = bytearray(message([(1, 0.5, [1.0], [2.0], [3.0])]))
    count_at = len(data) - 4 * 8 - 4
    data[count_at : count_at + 4] = struct.pack("<I", 2**32 - 1)
    with pytest.raises(ValueError, match="4294967295 persons do not fit"):
        decode(PERSON_POSES.name, bytes(data))
