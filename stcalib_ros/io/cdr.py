"""Common Data Representation, little-endian: the bytes of a ROS 2 message."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

_HEADER = b"\x00\x01\x00\x00"  # plain CDR, little-endian


class CdrWriter:
    """Appends the fields of one message in their order.

    Examples
    --------
    >>> cdr = CdrWriter()
    >>> cdr.boolean(True)
    >>> cdr.uint32(7)
    >>> cdr.data()[4:].hex()
    '0100000007000000'
    """

    def __init__(self) -> None:
        self._out = bytearray(_HEADER)

    def data(self) -> bytes:
        """Return the message so far, with its encapsulation header."""
        return bytes(self._out)

    def boolean(self, value: bool) -> None:
        """Append a ``bool``."""
        self._out.append(1 if value else 0)

    def int32(self, value: int) -> None:
        """Append an ``int32``."""
        self._pack("<i", value, 4)

    def uint32(self, value: int) -> None:
        """Append a ``uint32``."""
        self._pack("<I", value, 4)

    def float32(self, value: float) -> None:
        """Append a ``float32``."""
        self._pack("<f", value, 4)

    def string(self, value: str) -> None:
        """Append a ``string``."""
        encoded = value.encode() + b"\x00"
        self.uint32(len(encoded))
        self._out += encoded

    def strings(self, values: Sequence[str]) -> None:
        """Append a ``string[]``."""
        self.uint32(len(values))
        for value in values:
            self.string(value)

    def float32s(self, values: ArrayLike) -> None:
        """Append a ``float32[]``, an array of any shape row by row."""
        flat = np.asarray(values, dtype="<f4").ravel()
        self.uint32(flat.size)
        self._out += flat.tobytes()

    def float64s(self, values: ArrayLike, *, fixed: bool = False) -> None:
        """Append a ``float64[]``, or a ``float64[N]`` if `fixed`."""
        flat = np.asarray(values, dtype="<f8").ravel()
        if not fixed:
            self.uint32(flat.size)
        if flat.size:
            self._align(8)
            self._out += flat.tobytes()

    def _pack(self, form: str, value: float, size: int) -> None:
        self._align(size)
        self._out += struct.pack(form, value)

    def _align(self, size: int) -> None:
        self._out += bytes(-(len(self._out) - len(_HEADER)) % size)
