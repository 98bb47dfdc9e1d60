"""What a bag of ours was made from, as it is recorded in it."""

from __future__ import annotations

from pathlib import Path

from mcap.exceptions import McapError
from mcap.reader import SeekingReader

ORIGIN = "stcalib_origin"
"""Name of the record of metadata."""


def film_key(camera: str) -> str:
    """Return the name under which it is recorded which film a camera has."""
    return f"film of {camera}"


def read_origin(path: Path) -> dict[str, str]:
    """Return what a bag was made from; empty where it does not say, or is no bag.

    Parameters
    ----------
    path : Path
        MCAP file, which need not exist.
    """
    try:
        with path.open("rb") as stream:
            records = list(SeekingReader(stream).iter_metadata())
    except (OSError, McapError, ValueError, KeyError, EOFError):
        return {}
    return next((dict(one.metadata) for one in records if one.name == ORIGIN), {})
