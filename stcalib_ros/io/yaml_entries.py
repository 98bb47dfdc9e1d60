"""Values of a YAML file that know where they stand, so that errors can name it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.so3 import matrix_from_quaternion
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.recording import LensModel
from stcalib_ros.io.limits import MAX_COUNT, MAX_DISTANCE, MAX_MESSAGE, MAX_NUMBER, MAX_TIME_S
from stcalib_ros.io.plausible import require_name

_NORM_TOLERANCE = 1e-3
"""Deviation of the norm of a quaternion from 1. Numbers that somebody typed with four digits pass;
what is not meant as a rotation does not. Chosen, not measured."""
_SHOWN = 80
"""Characters of an unusable value that its error message shows: one line of a terminal."""


class Entry:
    """A value of the file that knows where it stands."""

    def __init__(self, value: Any, path: str, separator: str = ".") -> None:
        self.value = value
        self.path = path
        self._separator = separator

    def get(self, key: str, default: Any = None) -> Entry:
        """Entry of a mapping; an error if it is missing and has no default."""
        value = self._mapping().get(key, default)
        entry = Entry(value, f"{self.path}{self._separator}{key}")
        if value is None:
            raise InputError(f"{entry.path} is missing")
        return entry

    def items(self) -> list[tuple[str, Entry]]:
        """Entries of a mapping by name."""
        return [(str(k), Entry(v, f"{self.path}.{k}")) for k, v in self._mapping().items()]

    def elements(self) -> list[Entry]:
        """Entries of a list."""
        if not isinstance(self.value, list):
            raise self._expected("a list")
        return [Entry(v, f"{self.path}[{i}]") for i, v in enumerate(self.value)]

    def elements_of(self, count: int) -> list[Entry]:
        """Entries of a list of so many numbers."""
        entries = self.elements()
        if len(entries) != count:
            raise self._expected(f"{count} numbers")
        return entries

    def text(self) -> str:
        """Text; a number where a name is wanted is one, too."""
        if isinstance(self.value, Mapping | list | bool | None):
            raise self._expected("text")
        if len(text := str(self.value)) > MAX_MESSAGE:
            raise self._expected(f"at most {MAX_MESSAGE} characters")
        if not text.isascii() and text != text.encode(errors="replace").decode():
            raise self._expected("text in Unicode")
        return text

    def name(self) -> str:
        """Text that can be printed on one line."""
        return require_name(self.text(), self.path)

    def boolean(self) -> bool:
        """Read ``true`` or ``false``."""
        if not isinstance(self.value, bool):
            raise self._expected("true or false")
        return self.value

    def count(self) -> int:
        """Whole number that a message can hold: a count or an id."""
        if isinstance(self.value, bool) or not isinstance(self.value, int):
            raise self._expected("a whole number")
        if not 0 <= self.value <= MAX_COUNT:
            raise self._expected(f"a whole number from 0 to {MAX_COUNT}")
        return self.value

    def number(self) -> float:
        """Read a number; ``1e-5``, which YAML 1.1 takes for text, is one, too.

        NaN and infinity stand for what is not known.
        """
        if isinstance(self.value, int | float | str) and not isinstance(self.value, bool):
            try:
                return float(self.value)
            except (ValueError, OverflowError):
                pass
        raise self._expected("a number")

    def within(self, limit: float) -> float:
        """Read a finite number between plus and minus `limit`."""
        value = self.number()
        if not abs(value) <= limit:
            raise self._expected(f"a finite number between -{limit:.12g} and {limit:.12g}")
        return value

    def skew(self) -> float:
        """Clock skew, by which no clock stands still or runs backwards."""
        value = self.number()
        if not abs(value) < 1.0:
            raise self._expected("a clock skew between -1 and 1")
        return value

    def position(self) -> Float64Array:
        """Read x, y and z of a camera."""
        return np.array([e.within(MAX_DISTANCE) for e in self.elements_of(3)])

    def time(self) -> float:
        """Seconds that a stamp can hold."""
        return self.within(MAX_TIME_S)

    def numbers(self, count: int | None = None, *, finite: bool = True) -> Float64Array:
        """Flat list of numbers."""
        entries = self.elements() if count is None else self.elements_of(count)
        values = np.array([e.number() for e in entries], dtype=np.float64)
        if finite and not np.all(np.abs(values) <= MAX_NUMBER):
            raise self._expected("finite numbers")
        return values

    def status(self) -> Status:
        """Name of a `Status`."""
        try:
            return Status[str(self.value)]
        except KeyError:
            raise self._expected(f"one of {', '.join(s.name for s in Status)}") from None

    def rotation(self) -> Float64Array:
        """Rotation matrix of a quaternion x, y, z, w."""
        q = self.numbers(4)
        if abs(np.linalg.norm(q) - 1.0) > _NORM_TOLERANCE:
            raise self._expected("a unit quaternion x, y, z, w")
        return matrix_from_quaternion(q)

    def lens_model(self) -> LensModel:
        """Name of a `LensModel`."""
        try:
            return LensModel(self.value)
        except ValueError:
            raise self._expected(f"one of {', '.join(m.value for m in LensModel)}") from None

    def _mapping(self) -> Mapping[Any, Any]:
        if not isinstance(self.value, Mapping):
            raise self._expected("a mapping")
        return self.value

    def _expected(self, what: str) -> InputError:
        shown = repr(self.value)
        shown = shown if len(shown) <= _SHOWN else f"{shown[: _SHOWN - 3]}..."
        return InputError(f"{self.path}: expected {what}, got {shown}")
