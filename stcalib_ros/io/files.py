"""Files that are there whole or not at all."""

from __future__ import annotations

import codecs
import errno
import os
import re
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stcalib_ros.core.errors import InputError

_HEAD_BYTES = 1 << 16
"""Bytes at the begin of a file by which it is recognised: MMPose's, which begin with a description
of the joints, have 20,000 before the first pose. Measured."""
_TEMPORARY = re.compile(r"\.stcalib-(\d+)-[0-9a-f]{8}\.(tmp|probe)")
"""Names of what is being written, with the id of the process that writes it."""


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Path beside `path` to write to; it takes the place of `path` when the block ends well.

    It is on the disk by then, so that after a power failure there is either what was there before,
    or all of the new one. If the block raises anything, Ctrl-C included, nothing of it is left
    behind. Only regular files are replaced.

    Raises
    ------
    InputError
        The operating system refuses to write there, or `path` is a device, a pipe or a folder.
    """
    temporary = _beside(path, "tmp")
    try:
        _require_regular(path)
        yield temporary
        _sync(temporary)
        os.replace(temporary, path)
        sync_folder(path.parent)
    except OSError as error:
        raise InputError(f"cannot write {path}: {_reason(error)}") from error
    finally:
        _remove(temporary)


def sync_folder(folder: Path) -> None:
    """See to it that what was renamed in a folder has its name after a power failure, too."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:  # of file systems that cannot do it
            raise
    finally:
        os.close(descriptor)


def sweep(folder: Path) -> None:
    """Remove what processes that are gone were writing to a folder.

    Raises
    ------
    OSError
        The folder cannot be listed.
    """
    for path in folder.iterdir():
        writer = _TEMPORARY.fullmatch(path.name)
        if writer and (int(writer[1]) == os.getpid() or not _is_running(int(writer[1]))):
            _remove(path)


def read_bounded(path: Path, max_bytes: int) -> str:
    """Read a text file of at most `max_bytes`.

    Raises
    ------
    InputError
        It cannot be read, is longer or is no text.
    """
    try:
        with path.open("rb") as stream:
            data = stream.read(max_bytes + 1)
    except FileNotFoundError:
        raise InputError(f"no such file: {path}") from None
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {path}: {_reason(error)}") from error
    if len(data) > max_bytes:
        raise InputError(f"cannot read {path}: it has more than {max_bytes} bytes")
    try:
        return decoded(data)
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not a text file") from error


def decoded(data: bytes, errors: str = "strict") -> str:
    """Text of UTF-8, or of UTF-16 with its byte order mark, as Windows writes it; without the mark.

    Raises
    ------
    UnicodeDecodeError
        It is neither, and `errors` is not ``"ignore"``.
    """
    is_utf16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    return data.decode("utf-16" if is_utf16 else "utf-8-sig", errors=errors)


def head(path: Path) -> str:
    """Begin of a text file; empty if it is none or cannot be read."""
    try:
        with path.open("rb") as stream:
            return decoded(stream.read(_HEAD_BYTES), errors="ignore").lstrip()
    except OSError:
        return ""


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all.

    Raises
    ------
    InputError
        The operating system refuses to write there.
    """
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def require_writable(path: Path) -> None:
    """Make sure, before the long work, that `path` can be written at its end.

    Raises
    ------
    InputError
        Its folder does not exist or cannot be written to, or `path` is a folder.
    """
    probe = _beside(path, "probe")
    try:
        if path.is_dir():
            raise InputError(f"cannot write {path}: it is a folder; name a file")
        if not path.parent.is_dir():
            raise InputError(f"cannot write {path}: no such folder {path.parent}; create it first")
        _require_regular(path)
        probe.touch(exist_ok=False)
    except OSError as error:
        raise InputError(f"cannot write {path}: {_reason(error)}; choose another folder") from error
    finally:
        _remove(probe)


def make_folder(path: Path) -> None:
    """Make a folder if it is not there.

    Raises
    ------
    InputError
        The operating system refuses, or there is a file of that name.
    """
    try:
        path.mkdir(exist_ok=True)
    except FileExistsError:
        raise InputError(f"cannot write to the folder {path}: it is a file; name another") from None
    except OSError as error:
        raise InputError(
            f"cannot write to the folder {path}: {_reason(error)}; name another"
        ) from error


def _beside(path: Path, ending: str) -> Path:
    """Path in the same folder; short, whatever the length of the name."""
    return path.parent / f".stcalib-{os.getpid()}-{secrets.token_hex(4)}.{ending}"


def _require_regular(path: Path) -> None:
    if "\0" in path.name:
        raise InputError(f"cannot write {str(path)!r}: there is a null character in its name")
    if (path.exists() or path.is_symlink()) and not path.is_file() and not path.is_dir():
        raise InputError(f"cannot write {path}: it is not a regular file; name another")


def _sync(path: Path) -> None:
    """Have a file, or a folder with its files, on the disk."""
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        with file.open("rb+") as stream:
            os.fsync(stream.fileno())
    if path.is_dir():
        sync_folder(path)


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True  # it is another user's
    return True


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)


def _remove(path: Path) -> None:
    try:
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
    except (OSError, ValueError):
        return  # it could not be created either
