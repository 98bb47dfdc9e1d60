"""JSON files in, with errors of one line."""

from __future__ import annotations

import json
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
    try:
        return json.loads(read_bounded(path, MAX_JSON_BYTES))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not valid JSON: {error}") from error
