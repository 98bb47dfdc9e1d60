"""JSON in, with errors of one line, and JSON out."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.files import read_bounded
from stcalib_ros.io.limits import MAX_JSON_BYTES

MALFORMED = (KeyError, TypeError, ValueError, IndexError, OverflowError, AttributeError)
"""What reading raises where content has another form than it should: a missing key, text in the
place of a number, a number that no array holds."""


def read_json(path: Path) -> Any:
    """Read a JSON file.

    Raises
    ------
    InputError
        It cannot be read.
    """
    text = read_bounded(path, MAX_JSON_BYTES)
    if not text.strip():
        raise InputError(f"{path} is empty: write it again, or remove it")
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{path} is not valid JSON: {error}; was it written to its end?"
        ) from error


def json_text(plain: Any) -> str:
    """Return plain data as one JSON value in a line.

    Numbers that are not finite are null, for which JSON has no other word.

    Examples
    --------
    >>> json_text({"offset_s": float("nan"), "cameras": ("cam0", "cam1")})
    '{"offset_s": null, "cameras": ["cam0", "cam1"]}'
    """
    return json.dumps(_finite(plain), allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
