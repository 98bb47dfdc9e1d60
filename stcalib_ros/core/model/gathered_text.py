"""What is said of several cameras alike, said once."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence


def after_names(names: Sequence[str], text: str) -> str:
    """Return a text after the names that it is about, if there are any.

    Examples
    --------
    >>> after_names(("cam0", "cam1"), "nobody moves")
    'cam0, cam1: nobody moves'
    """
    return ": ".join(filter(None, [", ".join(names), text]))


def as_sentence(text: str, names: Sequence[str]) -> str:
    """Return a text with full stop and capital; names of cameras stay as they are.

    Examples
    --------
    >>> as_sentence("nobody moves", ["cam0"]), as_sentence("cam0: nobody moves", ["cam0"])
    ('Nobody moves.', 'cam0: nobody moves.')
    """
    begins_with_name = any(text.startswith(name) for name in names)
    return f"{text if begins_with_name else text[:1].upper() + text[1:]}."


def uncertain(size: float, limit: float, form: str) -> str:
    """Return how uncertain something is, by format and unit of a number.

    Examples
    --------
    >>> uncertain(1.23, 0.9, ".1f degrees"), uncertain(float("inf"), 0.9, ".1f degrees")
    ('uncertain by 1.2 degrees (limit 0.9)', 'not determined')
    """
    if not math.isfinite(size):
        return "not determined"
    number, _, unit = form.partition(" ")
    return f"uncertain by {size:{number}} {unit} (limit {limit:{number}})"


def gathered(items: Sequence[tuple[Hashable, tuple[str, ...], str]]) -> list[str]:
    """Return one text for every kind, after all the names that it is about.

    Where texts of one kind differ in their numbers, the first one stands for all.

    Parameters
    ----------
    items : sequence of (kind, names, text)
        Without names, each is by itself.

    Examples
    --------
    >>> gathered([("dark", ("cam0",), "2 % are dark"), ("dark", ("cam1",), "3 % are dark")])
    ['cam0: 2 % are dark; the same applies to cam1']
    """
    kinds: dict[Hashable, list[tuple[tuple[str, ...], str]]] = {}
    for kind, names, text in items:
        kinds.setdefault(kind if names else (kind, text), []).append((names, text))
    return [_together(found) for found in kinds.values()]


def _together(found: Sequence[tuple[tuple[str, ...], str]]) -> str:
    """Return one text of one kind."""
    first = found[0][1]
    same = dict.fromkeys(name for names, text in found if text == first for name in names)
    others = dict.fromkeys(name for names, _ in found for name in names if name not in same)
    tail = f"; the same applies to {', '.join(others)}" if others else ""
    return after_names(tuple(same), first) + tail
