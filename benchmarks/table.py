"""Tables of figures beside their targets, for every benchmark that has targets."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import IO, Any


@dataclass(frozen=True, slots=True)
class Row:
    """One figure of a table, its target, and whether it is met (None without a target)."""

    figure: str
    value: str
    target: str
    met: bool | None


def print_rows(title: str, rows: Iterable[Row], *, file: IO[str]) -> None:
    """Print the rows of one section under its title."""
    print(f"\n{title}", file=file)
    for row in rows:
        verdict = {True: "pass", False: "MISS", None: ""}[row.met]
        print(
            f"  {row.figure:14s} {row.value:44s} {row.target:18s} {verdict}", file=file, flush=True
        )


def finite(value: Any) -> Any:
    """Replace NaN and infinity, which JSON lacks, by None."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
