"""A folder of numbered calibrations, of which the newest is in force."""

from __future__ import annotations

import fcntl
import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.io.exports import Exported, ExportFormat, exported_files, write_files
from stcalib_ros.io.files import sweep, sync_folder, write_text
from stcalib_ros.io.limits import MAX_FILES
from stcalib_ros.io.results import read_result, result_text

_NAME = re.compile(r"calibration\.(\d{6,18})(\.withdrawn)?\.yaml", re.ASCII)

Usable = Callable[[Calibration], None]
"""Raises InputError for a calibration that cannot be put into force."""


@dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """A calibration of the history; number 0: it could not be saved."""

    number: int
    calibration: Calibration


class Found(NamedTuple):
    """The newest calibration that can be used, and why newer ones cannot."""

    kept: Kept | None
    skipped: tuple[str, ...]


class History:
    """Calibrations ``calibration.000001.yaml``, ``calibration.000002.yaml``, ... in a folder.

    The one with the highest number that can be used is in force. A file is there whole or not at
    all, and so the switch from one to the next cannot be caught half done. A rollback renames the
    file in force to ``calibration.NNNNNN.withdrawn.yaml``; numbers are never used again. One node
    to a folder.

    Parameters
    ----------
    folder : Path
        Made when something is written.
    keep : int
        So many files of the history are kept; older ones are removed.
    """

    def __init__(self, folder: Path, *, keep: int) -> None:
        self.folder = folder
        self._keep = keep
        self._lock: int | None = None

    def latest(self, usable: Usable) -> Found:
        """Read the newest calibration that can be used.

        Raises
        ------
        InputError
            The folder cannot be listed.
        """
        return self._newest(self._valid(), usable)

    def add(self, calibration: Calibration) -> int:
        """Put a calibration in force; returns its number.

        Raises
        ------
        InputError
            The operating system refuses to write there.
        """
        self._make_folder()
        number = max(self._files(), default=0) + 1
        write_text(self._path(number), result_text(calibration))
        with suppress(InputError):  # the new one is there; what cannot be removed stays
            files = self._files()
            for n in sorted(files)[: -self._keep]:
                with suppress(OSError):
                    files[n].unlink(missing_ok=True)
            self.sweep()
        return number

    def before(self, number: int, usable: Usable) -> tuple[Kept, tuple[str, ...]]:
        """Read the newest usable one before a number; before 0, which was not saved, of all.

        Also returned is why later ones cannot be used.

        Raises
        ------
        InputError
            There is none; the message says what is wrong with those that cannot be used.
        """
        earlier = {n: path for n, path in self._valid().items() if n < number or not number}
        kept, skipped = self._newest(earlier, usable)
        if kept is None:
            problems = "".join(f"; {problem}" for problem in skipped)
            raise InputError(f"{self.folder} has no earlier calibration to go back to{problems}")
        return kept, skipped

    def withdraw_after(self, number: int) -> None:
        """Withdraw all later calibrations, so that a numbered one is in force.

        Raises
        ------
        InputError
            The operating system refuses.
        """
        try:
            for n, path in sorted(self._valid().items(), reverse=True):
                if n > number:
                    path.rename(self.folder / f"{path.stem}.withdrawn.yaml")
            sync_folder(self.folder)
        except OSError as error:
            raise InputError(f"cannot rename files of {self.folder}: {error.strerror}") from error

    def sweep(self) -> None:
        """Remove what a killed process was writing.

        Raises
        ------
        InputError
            The folder cannot be listed.
        """
        if self._exists():
            with self._listing():
                sweep(self.folder)

    def claim(self) -> bool:
        """Hold the folder for this process, as long as it lives; false if another one does."""
        if self._lock is None:
            try:
                self._lock = os.open(self.folder, os.O_RDONLY)
            except OSError:
                return True  # there is none yet, or none that could be used
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            return True  # of a file system without locks
        return True

    def export(self, calibration: Calibration, name: str, form: ExportFormat) -> Path:
        """Write a calibration to a file or a folder of files below the folder, and nowhere else.

        Parameters
        ----------
        calibration : Calibration
        name : str
            Path relative to the folder; all of it but the last part must exist.
        form : ExportFormat
            One that is a file says what its name ends in; a folder does not end in ``.yaml``.

        Raises
        ------
        InputError
            The name is absolute, leads out of the folder by ``..`` or by a link, is one of the
            history's, is not one of the format, or cannot be written to; or the format cannot hold
            the calibration.
        """
        self._make_folder()
        with _writing(name):
            path = self._file_below(name) if form.endings else self._folder_below(name)
            files = exported_files(Exported(calibration), form, path)
            folder = path.parent if form.endings else path
            if not folder.exists():
                _require_room(folder.parent, 1)
                folder.mkdir()
            sweep(folder)
            _require_room(folder, sum(1 for file in files if not file.exists()))
        write_files(files)
        return path

    def _file_below(self, name: str) -> Path:
        path = self._below(name)
        if path.name.startswith("calibration."):
            raise InputError(f"{name!r}: name a file that does not begin with 'calibration.'")
        if path.is_dir():
            raise InputError(f"cannot write {name!r}: name a file in a folder that exists")
        return path

    def _folder_below(self, name: str) -> Path:
        path = self._below(name)
        if path.suffix == ".yaml" or (path.exists() and not path.is_dir()):
            raise InputError(f"{name!r}: name a folder, which does not end in .yaml")
        return path

    def _below(self, name: str) -> Path:
        relative = Path(name)
        if not name.isprintable():
            raise InputError(f"{name!r}: name a file by printable characters")
        if not relative.name or relative.is_absolute() or ".." in relative.parts:
            raise InputError(
                f"{name!r} is not a path below the results folder: no '/' first, no '..'"
            )
        root, path = self.folder.resolve(), self.folder / relative
        parent = path.parent.resolve(strict=True)
        if not parent.is_relative_to(root) or path.is_symlink():
            raise InputError(f"{name!r} is a link or leads through one out of the results folder")
        if not parent.is_dir():
            raise InputError(f"cannot write {name!r}: name a file in a folder that exists")
        return parent / path.name

    def _newest(self, files: Mapping[int, Path], usable: Usable) -> Found:
        """Read them from the newest on until one can be used."""
        skipped = []
        for number in sorted(files, reverse=True):
            try:
                calibration = read_result(_regular(files[number]))
                usable(calibration)
            except InputError as error:
                name = files[number].name
                skipped.append(str(error) if name in str(error) else f"{name}: {error}")
                continue
            return Found(Kept(number, calibration), tuple(skipped))
        return Found(None, tuple(skipped))

    def _make_folder(self) -> None:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot make {self.folder}: {error.strerror}") from error

    def _path(self, number: int) -> Path:
        return self.folder / f"calibration.{number:06d}.yaml"

    def _files(self) -> dict[int, Path]:
        """All files of the history by number."""
        if not self._exists():
            return {}
        with self._listing():
            found = list(self.folder.iterdir())
        return {int(m[1]): p for p in found if (m := _NAME.fullmatch(p.name))}

    def _valid(self) -> dict[int, Path]:
        """Those that were not withdrawn."""
        return {n: p for n, p in self._files().items() if p == self._path(n)}

    def _exists(self) -> bool:
        with self._listing():
            return self.folder.is_dir()

    @contextmanager
    def _listing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise InputError(f"cannot list {self.folder}: {error.strerror}") from error


@contextmanager
def _writing(name: str) -> Iterator[None]:
    try:
        yield
    except (OSError, RuntimeError) as error:  # RuntimeError: links in a circle
        problem = getattr(error, "strerror", error)
        raise InputError(f"cannot write {name!r}: {problem}") from error


def _require_room(folder: Path, n: int) -> None:
    """Demand that so many new files do not fill a folder beyond what it may hold."""
    if sum(1 for _ in folder.iterdir()) + n > MAX_FILES:
        raise InputError(f"{folder} has room for no more than {MAX_FILES} files; remove some")


def _regular(path: Path) -> Path:
    if not path.is_file():
        raise InputError(f"{path} is not a regular file")
    return path
