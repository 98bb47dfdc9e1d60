"""The comparison of message definitions in a bag with ours.

A changed definition can decode without an error into wrong numbers, so the text in the bag is
compared before anything is decoded.
"""

from __future__ import annotations

import difflib
import re

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.message_types import TYPES

_CONSTANT = re.compile(r"[a-z]\w+ [A-Z]\w* ?=")


def require_same_schema(topic: str, schema_name: str, text: str) -> None:
    """Compare a bag's definition of `schema_name` with ours.

    Parameters
    ----------
    topic : str
        For error messages.
    schema_name : str
        One of `stcalib_ros.io.message_types.TYPES`.
    text : str
        Definition in the bag, with those of the fields' types after lines of ``=``.

    Raises
    ------
    InputError
        They differ in more than comments and white space; the message shows where.
    """
    ours = _blocks(schema_name, TYPES[schema_name].schema_text())
    theirs = _blocks(schema_name, text)
    differences = [
        f"{name}: {line}"
        for name, fields in ours.items()
        if name in theirs or not name.startswith("builtin_interfaces/")
        for line in _difference(theirs.get(name, []), fields)
    ]
    if differences:
        raise InputError(
            f"{topic}: the bag was written with another definition of {schema_name} "
            f"(- bag, + ours): {'; '.join(differences)}; "
            "record it again, or read it with the version that wrote it"
        )


def _difference(theirs: list[str], ours: list[str]) -> list[str]:
    return [line for line in difflib.ndiff(theirs, ours) if line[0] in "-+"]


def _blocks(schema_name: str, text: str) -> dict[str, list[str]]:
    """Fields by type name, without comments, with single spaces."""
    top, *others = re.split(r"^={3,}\s*$", text, flags=re.MULTILINE)
    name = _short(schema_name)
    blocks = {name: _fields(name, top)}
    for block in others:
        head, _, body = block.strip().partition("\n")
        name = _short(head.removeprefix("MSG:").strip())
        blocks[name] = _fields(name, body)
    return blocks


def _short(type_name: str) -> str:
    return type_name.replace("/msg/", "/")


def _fields(owner: str, text: str) -> list[str]:
    """Fields of the type `owner`, their types with package; constants are no part of a message."""
    lines = (re.sub(r"\s+", " ", line.split("#", 1)[0]).strip() for line in text.splitlines())
    package = owner.partition("/")[0]
    return [
        re.sub(r"^(?=[A-Z]\w*[ \[])", f"{package}/", _short(line))
        for line in lines
        if line and not _CONSTANT.match(line)
    ]
