"""Arrays of ``.npz`` and ``.npy`` files, within the size that the files themselves have."""

from __future__ import annotations

import lzma
import math
import struct
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.limits import MAX_NPZ_BYTES

_NPY = b"\x93NUMPY"
"""Begin of an ``.npy`` file."""

_UNREADABLE = (
    *(ValueError, EOFError, KeyError, TypeError, IndexError, AttributeError, OverflowError),
    *(RuntimeError, NotImplementedError, SyntaxError, MemoryError, tokenize.TokenError),
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error),
)
"""What NumPy and zipfile raise for files that are damaged, encrypted or compressed unusually."""


def read_npz(path: Path) -> dict[str, NDArray[Any]]:
    """Read all arrays of an ``.npz`` file.

    Raises
    ------
    InputError
        It cannot be read, holds Python objects, is larger than `MAX_NPZ_BYTES` when unpacked, or
        an array says that it is larger than its data.
    """
    try:
        with path.open("rb") as stream:
            if stream.read(len(_NPY)) == _NPY:
                raise InputError(f"{path} holds a single array, not named arrays (.npz)")
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if (size := sum(member.file_size for member in members)) > MAX_NPZ_BYTES:
                raise InputError(
                    f"{path} has {size} bytes when unpacked, at most {MAX_NPZ_BYTES} are read"
                )
            return {
                member.filename.removesuffix(".npy"): _member(archive, member) for member in members
            }
    except FileNotFoundError:
        raise InputError(f"no such file: {path}") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except _UNREADABLE as error:
        raise InputError(f"{path} is not a readable .npz file: {error}") from error


def read_npy(path: Path) -> NDArray[Any]:
    """Read the array of an ``.npy`` file.

    Raises
    ------
    InputError
        It cannot be read, holds Python objects, or says that it is larger than its data.
    """
    try:
        with path.open("rb") as stream:
            _require_size(stream, path.stat().st_size)
            stream.seek(0)
            return _array(stream)
    except FileNotFoundError:
        raise InputError(f"no such file: {path}") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except _UNREADABLE as error:
        raise InputError(f"{path} is not a readable .npy file: {error}") from error


def _member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    with archive.open(member) as stream:
        _require_size(stream, member.file_size)
    with archive.open(member) as stream:
        return _array(stream)


def _array(stream: IO[bytes]) -> NDArray[Any]:
    return np.asarray(np.lib.format.read_array(stream, allow_pickle=False))


def _require_size(stream: IO[bytes], n_bytes: int) -> None:
    """Compare the size by the header of an array with that of its data, before it is allocated."""
    version = np.lib.format.read_magic(stream)
    if version == (1, 0):
        header = np.lib.format.read_array_header_1_0(stream)
    else:
        header = np.lib.format.read_array_header_2_0(stream)
    shape, _, dtype = header
    if dtype.hasobject:
        raise ValueError("an array of Python objects")
    if min(shape, default=0) < 0 or math.prod(shape) * max(dtype.itemsize, 1) > n_bytes:
        raise ValueError(f"an array of shape {shape} in {n_bytes} bytes")


def names_in_npz(path: Path) -> tuple[str, ...]:
    """Return the names of the arrays of an ``.npz`` file; none if it is no such file."""
    try:
        with zipfile.ZipFile(path) as archive:
            return tuple(name.removesuffix(".npy") for name in archive.namelist())
    except (OSError, *_UNREADABLE):
        return ()
