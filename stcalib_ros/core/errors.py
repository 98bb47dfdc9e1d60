"""Errors that the package raises; the command line maps them to exit statuses 2 and 3."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

_NEAR = 0.7
"""Similarity of two words, 0..1, from which on one may be meant by the other: the ratio of difflib.
At its usual
0.6, evaluate is near to calbrate."""


class StcalibError(Exception):
    """Base of every error this package raises on purpose.

    The message is one line for a person: it names the offending value and the next step.
    """

    exit_status = 2


class InputError(StcalibError):
    """Unusable arguments, files or messages (exit status 2)."""

    exit_status = 2


class CalibrationError(StcalibError):
    """No trustworthy calibration can be had from this data (exit status 3)."""

    exit_status = 3


class Cancelled(StcalibError):
    """The caller asked to stop; nothing was left half done (exit status 3)."""

    exit_status = 3


def one_line(text: str, limit: int) -> str:
    """Return one printable line of at most so many characters, whatever somebody's data put in it.

    Examples
    --------
    >>> one_line(f"a{chr(27)}[31mb{chr(10)}c", 100)
    'a?[31mb?c'
    """
    line = "".join(c if c.isprintable() else "?" for c in text[: limit + 1])
    return line if len(line) <= limit else f"{line[: limit - 3]}..."


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Say what a mistyped word could be; nothing if nothing is near.

    Examples
    --------
    >>> did_you_mean("--outptu", ["--output", "--report"])
    ': did you mean --output?'
    """
    near = get_close_matches(word, list(known), cutoff=_NEAR)
    return f": did you mean {' or '.join(near)}?" if near else ""
