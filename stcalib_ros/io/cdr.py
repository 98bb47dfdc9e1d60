"""Common Data Representation: the bytes of a ROS 2 message."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stcalib_ros.core.model.arrays import Float64Array

_HEADER = b"\x00\x01\x00\x00"  # plain CDR, little-endian


class CdrWriter:
    """Appends the fields of one message in their order, little-endian.

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


class CdrReader:
    """Takes the fields of one message in their order.

    Parameters
    ----------
    data : bytes
        With the encapsulation header, of either endianness.

    Raises
    ------
    ValueError, struct.error
        The data are not plain CDR, or end before the message does (here and in every method).
    """

    def __init__(self, data: bytes) -> None:
        if len(data) < len(_HEADER) or data[0] != 0 or data[1] > 1:
            raise ValueError(f"not plain CDR: it begins with {data[:4]!r}")
        self._data = data
        self._at = len(_HEADER)
        self._order = "<" if data[1] else ">"

    @property
    def left(self) -> int:
        """Bytes that have not been taken."""
        return len(self._data) - self._at

    def boolean(self) -> bool:
        """Take a ``bool``."""
        return bool(self._unpack("B", 1))

    def int8(self) -> int:
        """Take an ``int8``."""
        return int(self._unpack("b", 1))

    def int16(self) -> int:
        """Take an ``int16``."""
        return int(self._unpack("h", 2))

    def int32(self) -> int:
        """Take an ``int32``."""
        return int(self._unpack("i", 4))

    def uint32(self) -> int:
        """Take a ``uint32``."""
        return int(self._unpack("I", 4))

    def float32(self) -> float:
        """Take a ``float32``."""
        return self._unpack("f", 4)

    def count(self, least_bytes: int) -> int:
        """Take the length of an array whose elements have at least so many bytes."""
        count = self.uint32()
        if count * least_bytes > self.left:
            raise ValueError(f"an array of {count} does not fit into the message")
        return count

    def int32s(self, count: int) -> Float64Array:
        """Take an ``int32[N]``."""
        return self._array("i4", 4, count)

    def string(self) -> str:
        """Take a ``string``."""
        length = self.uint32()
        encoded = self._data[self._at : self._at + length]
        if len(encoded) < length:
            raise ValueError(f"a string of {length} bytes does not fit into the message")
        self._at += length
        return encoded.rstrip(b"\x00").decode()

    def strings(self) -> list[str]:
        """Take a ``string[]``."""
        count = self.uint32()
        if 4 * count > self.left:
            raise ValueError(f"{count} strings do not fit into the message")
        return [self.string() for _ in range(count)]

    def float32s(self, fixed: int | None = None) -> Float64Array:
        """Take a ``float32[]``, or a ``float32[N]`` of N = `fixed`."""
        return self._array("f4", 4, self.uint32() if fixed is None else fixed)

    def float64s(self, fixed: int | None = None) -> Float64Array:
        """Take a ``float64[]``, or a ``float64[N]`` of N = `fixed`."""
        return self._array("f8", 8, self.uint32() if fixed is None else fixed)

    def words(self, shape: tuple[int, int]) -> NDArray[np.uint32] | None:
        """Look at the next 4-byte words, without taking them; None if there are fewer."""
        self._align(4)
        count = shape[0] * shape[1]
        if self._at + 4 * count > len(self._data):
            return None
        words = np.frombuffer(self._data, self._order + "u4", count, self._at)
        return words.reshape(shape)

    def skip(self, n_bytes: int) -> None:
        """Take what `words` has shown."""
        self._at += n_bytes

    def _array(self, kind: str, size: int, count: int) -> Float64Array:
        if count == 0:
            return np.zeros(0)
        self._align(size)
        values = np.frombuffer(self._data, self._order + kind, count, self._at)
        self._at += size * count
        return values.astype(np.float64)

    def _unpack(self, form: str, size: int) -> float:
        self._align(size)
        (value,) = struct.unpack_from(self._order + form, self._data, self._at)
        self._at += size
        return float(value) if form == "f" else int(value)

    def _align(self, size: int) -> None:
        self._at += -(self._at - len(_HEADER)) % size
