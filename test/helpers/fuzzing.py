"""Mutants of files and messages, for a bounded time: a door takes or refuses each, and no more."""

from __future__ import annotations

import copy
import json
import math
import os
import random
import signal
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

from stcalib_ros.core.errors import StcalibError

CORPUS = Path(__file__).parents[1] / "corpus"
"""A folder for every door, with what once did harm; new finds belong there."""

SECONDS = float(os.environ.get("STCALIB_FUZZ_S", "2"))
"""For each door; longer by hand."""

HANG_S = 20
VALUES = (
    *(None, True, False, 0, -1, 1, 2**31, 2**32, 2**63, 2**64, 10**30, 10**400, 0.0, -0.0, 1e-320),
    *(1e20, 1e300, -1e300, math.nan, math.inf, "", "x", "nan", "1e5", "~", "cam0", [], [1], {}),
    *({"a": 1}, [[]], "\u202e", "\x1b[31m\n", "x" * 5000, [1, 2, 3], [math.nan] * 4, [1e300] * 3),
)
WORDS = (
    *(b"!!int ''", b"!!float ''", b"!!bool x", b"!!timestamp x", b"!!binary '@'", b"!!set {a, b}"),
    *(b"!!python/name:os.system", b"!!omap [a: 1]", b"!!str [a]", b"!!map [a]", b"*nope"),
    *(b"&a [*a]", b"<<: 1", b"{[1]: 2}", b"1:2:3", b"2001-02-30", b"? a", b"|\n  x", b"[[[[[[[["),
)

Door = Callable[[bytes], object]


class Hang(BaseException):
    """Nothing that takes so long has been bounded."""


def _hang(_number: int, _frame: FrameType | None) -> None:
    raise Hang(f"more than {HANG_S} s")


def corpus(name: str) -> list[Path]:
    """Files that are kept for a door."""
    found = sorted((CORPUS / name).iterdir())
    assert found, f"nothing in {CORPUS / name}"
    return found


def attack(door: Door, mutants: Iterator[bytes], keep: Path) -> int:
    """Give a door mutants until the time is over; return how many it took and did not refuse.

    A mutant that makes it raise anything but an error of ours is kept, and named in the failure.
    """
    n_taken, until = 0, time.monotonic() + SECONDS
    signal.signal(signal.SIGALRM, _hang)
    for mutant in mutants:
        signal.alarm(HANG_S)
        try:
            n_taken += taken(door, mutant)
        except BaseException as error:
            keep.write_bytes(mutant)
            at = traceback.extract_tb(error.__traceback__)[-1]
            raise AssertionError(
                f"{type(error).__name__}: {error} in {at.filename}:{at.lineno} for {keep}; "
                f"copy it to {CORPUS} when it is mended"
            ) from error
        finally:
            signal.alarm(0)
        if time.monotonic() > until:
            break
    return n_taken


def taken(door: Door, data: bytes) -> bool:
    """Whether a door takes something; it may refuse it, in one line."""
    try:
        door(data)
    except StcalibError as error:
        if "\n" in str(error):
            raise ValueError(f"not one line: {error!r}") from error
        return False
    return True


def of_bytes(seeds: Sequence[bytes], rng: random.Random) -> Iterator[bytes]:
    """Mutants of files as they are: changed, cut, copied and foreign bytes."""
    while True:
        data = bytearray(rng.choice(seeds))
        for _ in range(rng.choice([1, 1, 2, 5])):
            at, kind = rng.randrange(len(data) or 1), rng.randrange(6)
            if kind == 0 and data:
                data[at] = rng.randrange(256)
            elif kind == 1:
                del data[at : at + rng.randrange(1, 40)]
            elif kind == 2:
                data[at:at] = rng.choice(WORDS)
            elif kind == 3:
                data = data[: at + 1]
            elif kind == 4:
                other = rng.choice(seeds)
                start = rng.randrange(len(other) or 1)
                data[at:at] = other[start : start + rng.randrange(1, 60)]
            else:
                data[at : at + 4] = rng.choice([0, 1, 2**31, 2**32 - 1]).to_bytes(4, "little")
        yield bytes(data)


def of_tree(tree: Any, write: Callable[[Any], str], rng: random.Random) -> Iterator[bytes]:
    """Mutants of the content of a file: entries replaced, removed, exchanged."""
    places = list(_places(tree))
    while True:
        changed = copy.deepcopy(tree)
        for _ in range(rng.choice([1, 1, 1, 2, 4])):
            *way, last = rng.choice(places)
            at = changed
            try:
                for key in way:
                    at = at[key]
                if rng.random() < 0.2:
                    del at[last]
                else:
                    at[last] = rng.choice(VALUES)
            except (KeyError, IndexError, TypeError):
                continue  # it is gone, or another value now
        try:
            yield write(changed).encode(errors="surrogatepass")
        except ValueError:
            continue  # a number that the format does not have


def both(first: Iterator[bytes], second: Iterator[bytes]) -> Iterator[bytes]:
    """Take turns."""
    for pair in zip(first, second, strict=False):
        yield from pair


def to_json(tree: Any) -> str:
    return json.dumps(tree)


def _places(tree: Any, way: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    keys = tree if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) else ()
    for key in keys:
        yield (*way, key)
        yield from _places(tree[key], (*way, key))
