"""YAML files of OpenCV's FileStorage.

They are read without OpenCV, whose reader corrupts memory on damaged ones.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.io.files import read_bounded
from stcalib_ros.io.limits import MAX_YAML_LENGTH
from stcalib_ros.io.yaml_files import parse_yaml

_HEADER = re.compile(r"\A%YAML[: ]1\.\d+")
"""First line, ``%YAML:1.0``, which is none of YAML."""

_MATRIX = "opencv-matrix"


class OpencvStorage:
    """Content of a file.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        It cannot be read, or is not such a file.
    """

    def __init__(self, path: Path) -> None:
        text = _HEADER.sub("#", read_bounded(path, MAX_YAML_LENGTH), count=1)
        content = parse_yaml(text, str(path), mapping_tags=[_MATRIX])
        if not isinstance(content, Mapping):
            raise InputError(f"{path} is not a file of OpenCV's FileStorage")
        self._content = content

    def names(self, key: str) -> list[str]:
        """Return a list of names; a KeyError or TypeError if there is none."""
        values = self._content[key]
        if not isinstance(values, list) or any(isinstance(v, list | Mapping) for v in values):
            raise TypeError(f"{key} is not a list of names")
        return [str(value) for value in values]

    def number(self, key: str) -> float:
        """Return a number; 0 if there is none."""
        return float(self._content.get(key, 0.0))

    def matrix(self, key: str) -> Float64Array:
        """Return a matrix; a KeyError, TypeError or ValueError if there is none."""
        entry = self._content[key]
        if not isinstance(entry, Mapping):
            raise TypeError(f"{key} is not a matrix")
        values: Float64Array = np.array([_number(value) for value in entry["data"]])
        return values.reshape(int(entry["rows"]), int(entry["cols"]))


def _number(value: object) -> float:
    """Return a number; OpenCV writes ``.Nan``, which YAML takes for text."""
    return float(value.removeprefix(".") if isinstance(value, str) else value)  # type: ignore[arg-type]
