"""Tables of figures beside their targets, for every benchmark that has targets."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import IO, Any

_VERDICT = {True: "pass", False: "MISS", None: ""}


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
        print(
            f"  {row.figure:14s} {row.value:44s} {row.target:18s} {_VERDICT[row.met]}",
            file=file,
            flush=True,
        )


def print_beside(
    title: str, columns: Sequence[tuple[str, Sequence[Row]]], *, file: IO[str]
) -> None:
    """Print the rows of one section under its title, in columns with a heading each.

    Rows with the same figure are in one line.
    """
    print(f"\n{title}", file=file)
    print(
        f"  {'':18s} {'   '.join(f'{heading:70s}' for heading, _ in columns)}".rstrip(), file=file
    )
    by_figure = [{row.figure: row for row in rows} for _, rows in columns]
    for figure in dict.fromkeys(row.figure for _, rows in columns for row in rows):
        cells = "   ".join(_cell(rows.get(figure)) for rows in by_figure)
        print(f"  {figure:18s} {cells}".rstrip(), file=file, flush=True)


def _cell(row: Row | None) -> str:
    if row is None:
        return f"{'':70s}"
    return f"{row.value:41s} {row.target:23s} {_VERDICT[row.met]:4s}"


def finite(value: Any) -> Any:
    """Replace NaN and infinity, which JSON lacks, by None."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
