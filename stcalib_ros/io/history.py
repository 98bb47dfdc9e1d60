"""A folder of numbered calibrations, of which the newest is in force."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.io.files import write_text
from stcalib_ros.io.limits import MAX_FILES
from stcalib_ros.io.results import read_result, result_text

_NAME = re.compile(r"calibration\.(\d{6})(\.withdrawn)?\.yaml")


@dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """A calibration of the history; number 0: it could not be saved."""

    number: int
    calibration: Calibration


class History:
    """Calibrations ``calibration.000001.yaml``, ``calibration.000002.yaml``, ... in a folder.

    The one with the highest number is in force. It is there whole or not at all, and so the switch
    from one to the next cannot be caught half done; what a killed process was writing is removed
    with the next one. A rollback renames the file in force to
    ``calibration.NNNNNN.withdrawn.yaml``; numbers are never used again. One node to a folder.

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

    def latest(self) -> Kept | None:
        """Read the calibration in force; None if there is none.

        Raises
        ------
        InputError
            The file cannot be read; the message names it.
        """
        valid = self._valid()
        if not valid:
            return None
        number = max(valid)
        return Kept(number, read_result(valid[number]))

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
        files = self._files()
        leftovers = self.folder.glob(".calibration.*.tmp")
        with suppress(OSError):  # the new one is there; what cannot be removed stays
            for path in (*(files[n] for n in sorted(files)[: -self._keep]), *leftovers):
                path.unlink(missing_ok=True)
        return number

    def before(self, number: int) -> Kept:
        """Read the calibration before a numbered one; before 0, which was not saved, the newest.

        Raises
        ------
        InputError
            There is none, or it cannot be read.
        """
        earlier = {n: path for n, path in self._valid().items() if n < number or not number}
        if not earlier:
            raise InputError(f"{self.folder} has no earlier calibration to go back to")
        return Kept(max(earlier), read_result(earlier[max(earlier)]))

    def withdraw_after(self, number: int) -> None:
        """Withdraw all later calibrations, so that a numbered one is in force.

        Raises
        ------
        InputError
            The operating system refuses.
        """
        for n, path in sorted(self._valid().items(), reverse=True):
            if n > number:
                try:
                    path.rename(self.folder / f"calibration.{n:06d}.withdrawn.yaml")
                except OSError as error:
                    raise InputError(f"cannot rename {path}: {error.strerror}") from error

    def export(self, calibration: Calibration, name: str) -> Path:
        """Write a calibration to a file below the folder, and nowhere else.

        Parameters
        ----------
        calibration : Calibration
        name : str
            Path relative to the folder, ending in ``.yaml``; its folder must exist.

        Raises
        ------
        InputError
            The name is absolute, leads out of the folder by ``..`` or by a link, is one of the
            history's, or cannot be written to.
        """
        self._make_folder()
        path = self._below(name)
        if not path.exists() and sum(1 for _ in path.parent.iterdir()) >= MAX_FILES:
            raise InputError(f"{path.parent} has {MAX_FILES} files already; remove some")
        write_text(path, result_text(calibration))
        return path

    def _below(self, name: str) -> Path:
        relative = Path(name)
        if not name or "\0" in name or relative.is_absolute() or ".." in relative.parts:
            raise InputError(
                f"{name!r} is not a path below the results folder: no '/' first, no '..'"
            )
        if relative.suffix != ".yaml" or relative.name.startswith("calibration."):
            raise InputError(
                f"{name!r}: name a file that ends in .yaml and does not begin with 'calibration.'"
            )
        root, path = self.folder.resolve(), self.folder / relative
        try:
            parent = path.parent.resolve(strict=True)
            is_link = path.is_symlink()
        except OSError as error:
            raise InputError(f"cannot write {name!r}: {error.strerror}") from error
        if not parent.is_relative_to(root) or is_link:
            raise InputError(f"{name!r} is a link or leads through one out of the results folder")
        if not parent.is_dir() or path.is_dir():
            raise InputError(f"cannot write {name!r}: name a file in a folder that exists")
        return parent / path.name

    def _make_folder(self) -> None:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot make {self.folder}: {error.strerror}") from error

    def _path(self, number: int) -> Path:
        return self.folder / f"calibration.{number:06d}.yaml"

    def _files(self) -> dict[int, Path]:
        """All files of the history by number."""
        found = self.folder.iterdir() if self.folder.is_dir() else ()
        return {int(m[1]): p for p in found if (m := _NAME.fullmatch(p.name))}

    def _valid(self) -> dict[int, Path]:
        """Those that were not withdrawn."""
        return {n: p for n, p in self._files().items() if p == self._path(n)}
