"""What depends on the limits that publish or refuse a calibration.

    python -m benchmarks.accuracy.limits                     # from the evidence in limits.json
    python -m benchmarks.accuracy.limits --again --jobs 2    # gather it anew (ten minutes)
    python -m benchmarks.accuracy.limits --again --scenes 50

Decides once more on every solution that was checked, with each limit 20 % smaller, 20 % larger,
and left out: how many good solutions would be refused, how many wrong ones published. Limits
overlap; what one refuses alone, with all others left out, is counted beside that.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from benchmarks.accuracy.evidence import Row, Table, gather, read_table, write_table
from benchmarks.accuracy.scenarios import HARD, SCENARIOS
from stcalib_ros.core.validation.camera_checks import rejection
from stcalib_ros.core.validation.thresholds import DEFAULT, CheckThresholds

TABLE = Path(__file__).with_name("limits.json")
"""The evidence that was gathered last."""

CHANGE = 0.2
"""Fraction by which each limit is moved."""

EARLIER = ("many_outliers", "max_failed_fraction")
"""Limits that act while the evidence is gathered: they cannot be replayed."""

_HARD_FACTOR = 4
"""Hard scenes for one of the others: most solutions that limits have to refuse are among them."""

_DISABLED = {"min": float("-inf"), "max": float("inf")}
"""Values that no camera violates, by how the names of limits begin."""

_TOGETHER = {
    "min_explained_fraction": (
        "certain_rotation_stddev",
        "certain_bone_rotation",
        "certain_limb_variation",
        "certain_offset_peak_ratio",
    ),
    "min_explained_fraction_if_short": ("min_shared_s",),
    "min_shared_s": ("min_explained_fraction_if_short",),
}
"""Limits that one rule has in common."""


@dataclass(frozen=True, slots=True)
class Count:
    """Decisions on some solutions.

    Attributes
    ----------
    good_refused : int
        Number of solutions within the bounds of a solved scene that are refused.
    wrong_refused : int
        Number of solutions beyond these bounds that are refused.
    wrong_published : int
        Number of solutions beyond these bounds that are published.
    """

    good_refused: int
    wrong_refused: int
    wrong_published: int


@dataclass(frozen=True, slots=True)
class Replay:
    """Decisions with one limit changed.

    Attributes
    ----------
    limit : str
    value : float
        The limit as it is.
    smaller, larger : Count
        With the limit moved by `CHANGE`.
    without : Count or None
        Without the limit; None where it only makes an exception from another one.
    alone : Count or None
        With this limit only, and those of the same rule; without solutions that no limit is needed
        to refuse: look-alikes, infinite standard deviations.
    """

    limit: str
    value: float
    smaller: Count
    larger: Count
    without: Count | None
    alone: Count | None


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; gather the evidence before if asked to."""
    args = _arguments(argv)
    if args.again:
        kinds = [(kind, args.scenes) for kind in SCENARIOS]
        kinds += [(kind, _HARD_FACTOR * args.scenes) for kind in HARD]
        write_table(TABLE, gather(kinds, jobs=args.jobs))
    print_table(read_table(TABLE))
    return 0


def count(rows: Iterable[Row], thresholds: CheckThresholds = DEFAULT) -> Count:
    """Count wrong decisions by some limits."""
    found: Counter[tuple[bool, bool]] = Counter()
    for row in rows:
        is_sound = all(rejection(checks, thresholds) is None for checks in row.checks)
        found[row.good, is_sound and not row.refused_otherwise] += 1
    return Count(found[True, False], found[False, False], found[False, True])


def without_bones(rows: Iterable[Row]) -> list[Row]:
    """Return the rows as they are where there are no 3D poses whose bones could be compared."""
    nan = float("nan")
    return [
        replace(row, checks=tuple(replace(one, bone_rotation=nan) for one in row.checks))
        for row in rows
    ]


def replay(rows: Sequence[Row]) -> tuple[Replay, ...]:
    """Count wrong decisions with every limit changed, one at a time."""
    return tuple(
        _with_changed(rows, field.name)
        for field in fields(CheckThresholds)
        if field.name not in EARLIER
    )


def _with_changed(rows: Sequence[Row], limit: str) -> Replay:
    value = float(getattr(DEFAULT, limit))
    off = _disabled(limit)

    def counted(changed: Any) -> Count:
        return count(rows, replace(DEFAULT, **{limit: changed}))

    return Replay(
        limit,
        value,
        counted((1.0 - CHANGE) * value),
        counted((1.0 + CHANGE) * value),
        None if off is None else counted(off),
        None if off is None else count(_by_checks(rows), _only(limit)),
    )


def _disabled(limit: str) -> float | None:
    return _DISABLED.get(limit.partition("_")[0])


def _only(limit: str) -> CheckThresholds:
    """CheckThresholds without any limits but those of one rule."""
    kept = (limit, *_TOGETHER.get(limit, ()))
    off: Any = {
        field.name: value
        for field in fields(CheckThresholds)
        if field.name not in kept and (value := _disabled(field.name)) is not None
    }
    return replace(DEFAULT, **off)


def _by_checks(rows: Iterable[Row]) -> list[Row]:
    """Rows that count as refused by their limits alone."""
    without = _only("")
    return [
        replace(row, refused_otherwise=False)
        for row in rows
        if all(rejection(checks, without) is None for checks in row.checks)
    ]


def print_table(table: Table) -> None:
    """Print the counts on simulated scenes, and apart from them those on real recordings."""
    _print_rows("simulated scenes", [row for row in table.rows if not row.real])
    _print_rows(
        "real recordings, which fit worse: one clip of 1.7 s with four, three and two cameras",
        [row for row in table.rows if row.real],
    )
    print(f"\nacts before, not replayed: {', '.join(EARLIER)}")
    print(f"scenes and recordings without any solution: {table.unsolved}")
    if table.absent:
        print(f"recordings that were absent: {len(table.absent)} ({', '.join(table.absent)})")


def _print_rows(title: str, rows: Sequence[Row]) -> None:
    now, good = count(rows), sum(row.good for row in rows)
    print(f"\n{title}: {len(rows)} solutions, {good} good, {len(rows) - good} wrong")
    print(f"refused though good: {now.good_refused}; published though wrong: {now.wrong_published}")
    bare = count(without_bones(rows))
    print(
        f"without bones of 3D poses: refused though good: {bare.good_refused}; "
        f"published though wrong: {bare.wrong_published}"
    )
    columns = ("-20 %", "+20 %", "without")
    group = "{:46s}{:^24s}  {:^24s}  {:^16s}"
    print(group.format("", "good refused", "wrong published", "refused alone"))
    heads = (_cells(columns), _cells(columns), _cells(("good", "wrong")))
    print(f"  {'limit':36s} {'value':>7s}", *heads, sep="  ")
    for one in replay(rows):
        changed = (one.smaller, one.larger, one.without)
        refused = _cells("-" if c is None else c.good_refused for c in changed)
        published = _cells("-" if c is None else c.wrong_published for c in changed)
        alone = (
            ("-", "-") if one.alone is None else (one.alone.good_refused, one.alone.wrong_refused)
        )
        print(f"  {one.limit:36s} {one.value:7g}  {refused}  {published}  {_cells(alone)}")


def _cells(values: Iterable[object]) -> str:
    return "".join(f"{value!s:>8s}" for value in values)


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.accuracy.limits", description=__doc__
    )
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--again", action="store_true", help="gather the evidence anew")
    parser.add_argument(
        "--scenes",
        type=int,
        default=5,
        metavar="N",
        help=f"scenes of each kind, and {_HARD_FACTOR} N of the hard ones (default 5)",
    )
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes (default 1)")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
