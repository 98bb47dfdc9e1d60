"""TOML files in, with errors of one line."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.files import read_bounded
from stcalib_ros.io.limits import MAX_YAML_LENGTH

_toml = importlib.import_module("tomllib" if sys.version_info >= (3, 11) else "tomli")


def read_toml(path: Path) -> Mapping[str, Any]:
    """Content of a TOML file.

    Raises
    ------
    InputError
        The file cannot be read, is not TOML, or is larger or deeper than any that is of use.
    """
    text = read_bounded(path, MAX_YAML_LENGTH)
    try:
        content: Mapping[str, Any] = _toml.loads(text)
    except RecursionError:
        raise InputError(f"{path} cannot be read as TOML: it has too many levels") from None
    except ValueError as error:
        raise InputError(f"{path} is not valid TOML: {error}") from None
    return content
