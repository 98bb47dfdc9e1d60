"""Files of OpenCV's FileStorage: YAML, XML and JSON.

They are read without OpenCV, whose reader corrupts memory on damaged ones.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.io.files import read_bounded
from stcalib_ros.io.limits import MAX_YAML_DEPTH, MAX_YAML_LENGTH
from stcalib_ros.io.yaml_files import parse_yaml

_HEADER = re.compile(r"\A%YAML[: ]1\.\d+")
"""First line, ``%YAML:1.0``, which is none of YAML."""

_MATRIX = "opencv-matrix"
_XML_ROOT = "opencv_storage"


class OpencvStorage:
    """Content of a file.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    content : mapping
        Values by key; a matrix is a mapping to ``rows``, ``cols`` and ``data``.

    Raises
    ------
    InputError
        It cannot be read, or is not such a file.
    """

    def __init__(self, path: Path) -> None:
        text = read_bounded(path, MAX_YAML_LENGTH)
        if text.lstrip().startswith("<"):
            content = _xml_content(text, path)
        else:
            text = _HEADER.sub("#", text, count=1)
            content = parse_yaml(text, str(path), mapping_tags=[_MATRIX])
        if not isinstance(content, Mapping):
            raise InputError(f"{path} is not a file of OpenCV's FileStorage")
        self.content: Mapping[Any, Any] = content

    def names(self, key: str) -> list[str]:
        """Return a list of names; a KeyError or TypeError if there is none."""
        values = self.content[key]
        if not isinstance(values, list) or any(isinstance(v, list | Mapping) for v in values):
            raise TypeError(f"{key} is not a list of names")
        return [str(value) for value in values]

    def number(self, key: str) -> float:
        """Return a number; 0 if there is none."""
        return float(self.content.get(key, 0.0))

    def matrix(self, key: str) -> Float64Array:
        """Return a matrix; a KeyError, TypeError or ValueError if there is none."""
        entry = self.content[key]
        if not isinstance(entry, Mapping):
            raise TypeError(f"{key} is not a matrix")
        return matrix_of(entry)


def matrix_of(entry: Mapping[Any, Any]) -> Float64Array:
    """Return a matrix from its rows, cols and data; a KeyError or ValueError if there is none."""
    values: Float64Array = np.array([_number(value) for value in entry["data"]])
    return values.reshape(int(entry["rows"]), int(entry["cols"]))


def _number(value: object) -> float:
    """Return a number; OpenCV writes ``.Nan``, which YAML takes for text."""
    return float(value.removeprefix(".") if isinstance(value, str) else value)  # type: ignore[arg-type]


def _xml_content(text: str, path: Path) -> Mapping[str, Any]:
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(f"{path} is not a file of OpenCV's FileStorage: it declares entities")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise InputError(f"{path} is not valid XML: {error}") from None
    if root.tag != _XML_ROOT:
        raise InputError(
            f"{path} is not a file of OpenCV's FileStorage: expected <{_XML_ROOT}>, got "
            f"<{root.tag}>"
        )
    return {child.tag: _xml_value(child, path, 1) for child in root}


def _xml_value(element: ET.Element, path: Path, depth: int) -> Any:
    """Return what YAML would have there; numbers stay text."""
    if depth > MAX_YAML_DEPTH:
        raise InputError(f"{path}: it is more than {MAX_YAML_DEPTH} levels deep")
    if not len(element):
        words = (element.text or "").split()
        is_list = element.tag == "data" or len(words) > 1
        return words if is_list else "".join(words)
    values = [(child.tag, _xml_value(child, path, depth + 1)) for child in element]
    return [value for _, value in values] if values[0][0] == "_" else dict(values)
