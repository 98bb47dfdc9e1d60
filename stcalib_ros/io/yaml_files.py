"""YAML text as plain data, within bounds, with errors of one line.

Every door by which YAML comes in uses this: result files, configurations, parameters, the metadata
of bags, files of other programs. Values are made from the parser's events; nothing of PyYAML that
constructs objects is used, so that no tag makes anything but text, numbers, lists and mappings.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.files import read_bounded
from stcalib_ros.io.limits import (
    MAX_YAML_DEPTH,
    MAX_YAML_LENGTH,
    MAX_YAML_NODES,
    MAX_YAML_NUMBER,
)

_Parser = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the same events in a tenth of the time
_TAG = "tag:yaml.org,2002:"
_SEQUENCE, _MAPPING, _TEXT = f"{_TAG}seq", f"{_TAG}map", f"{_TAG}str"
_SCALARS: Mapping[str, tuple[type, ...]] = {
    f"{_TAG}int": (int,),
    f"{_TAG}float": (float, int),
    f"{_TAG}bool": (bool,),
    f"{_TAG}null": (type(None),),
}
_WORDS: Mapping[str, bool | float | None] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"), True),
    **dict.fromkeys(("no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"), False),
    **dict.fromkeys((".inf", ".Inf", ".INF", "+.inf", "+.Inf", "+.INF"), math.inf),
    **dict.fromkeys(("-.inf", "-.Inf", "-.INF"), -math.inf),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), math.nan),
}
_INT = re.compile(r"[-+]?(0|[1-9][0-9_]*)|[-+]?0x[0-9a-fA-F_]+|[-+]?0b[01_]+|[-+]?0[0-7_]+")
_FLOAT = re.compile(
    r"[-+]?([0-9][0-9_]*)\.[0-9_]*([eE][-+][0-9]+)?|[-+]?\.[0-9][0-9_]*([eE][-+][0-9]+)?"
)


@dataclass(slots=True)
class _Open:
    """A list or mapping that has not ended."""

    values: list[Any] | dict[Any, Any]
    anchor: str | None
    before: int
    key: Any = None
    has_key: bool = False
    merges: bool = False
    merged: dict[Any, Any] = field(default_factory=dict)

    def content(self) -> list[Any] | dict[Any, Any]:
        """Return what was given, on top of what was merged into it."""
        return {**self.merged, **self.values} if isinstance(self.values, dict) else self.values


def read_yaml(path: Path) -> Any:
    """Content of a YAML file.

    Raises
    ------
    InputError
        The file cannot be read, is not YAML, gives a key twice, or is larger or deeper than any
        file of ours.
    """
    return parse_yaml(read_bounded(path, MAX_YAML_LENGTH), str(path))


def parse_yaml(
    text: str,
    what: str,
    *,
    max_length: int = MAX_YAML_LENGTH,
    max_nodes: int = MAX_YAML_NODES,
    mapping_tags: Collection[str] = (),
) -> Any:
    """Content of YAML text.

    Parameters
    ----------
    text : str
    what : str
        Names it in errors.
    max_length : int
        Characters.
    max_nodes : int
        Values, each counted as often as anchors repeat it.
    mapping_tags : collection of str
        Tags that mappings may have besides that of plain ones.

    Raises
    ------
    InputError
        It is not YAML, gives a key twice, has a tag that is not one of plain data, or exceeds a
        bound.
    """
    if len(text) > max_length:
        raise InputError(
            f"{what} is too long: it has {len(text)} characters, and at most {max_length} are read"
        )
    try:
        return _Content(what, max_nodes, mapping_tags).of(yaml.parse(text, Loader=_Parser))
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split()).replace('in "<unicode string>",', "at")
        raise InputError(f"{what} is not valid YAML: {reason}") from error


class _Content:
    """Makes plain data of the events of one document."""

    def __init__(self, what: str, max_nodes: int, mapping_tags: Collection[str]) -> None:
        self._what, self._max_nodes = what, max_nodes
        self._tags = {
            yaml.SequenceStartEvent: ("", "!", _SEQUENCE),
            yaml.MappingStartEvent: ("", "!", _MAPPING, *(_TAG + tag for tag in mapping_tags)),
        }
        self._n_nodes = 0
        self._open: list[_Open] = []
        self._anchors: dict[str, tuple[Any, int]] = {}
        self._documents: list[Any] = []

    def of(self, events: Iterator[Any]) -> Any:
        """Return the content; None of an empty text."""
        for event in events:
            if isinstance(event, yaml.ScalarEvent):
                self._count(1, event)
                self._put(self._scalar(event), event, event.anchor, self._n_nodes - 1)
            elif isinstance(event, yaml.CollectionStartEvent):
                self._begin(event)
            elif isinstance(event, yaml.CollectionEndEvent):
                ended = self._open.pop()
                self._put(ended.content(), event, ended.anchor, ended.before)
            elif isinstance(event, yaml.AliasEvent):
                self._repeat(event)
        if len(self._documents) > 1:
            raise InputError(f"{self._what} is not valid YAML for us: it has several documents")
        return self._documents[0] if self._documents else None

    def _begin(self, event: Any) -> None:
        if (event.tag or "") not in self._tags[type(event)]:
            raise self._error(event, f"the tag {event.tag!r} is none of plain data")
        if len(self._open) >= MAX_YAML_DEPTH:
            raise self._error(event, f"it is more than {MAX_YAML_DEPTH} levels deep")
        self._count(1, event)
        is_list = isinstance(event, yaml.SequenceStartEvent)
        self._open.append(_Open([] if is_list else {}, event.anchor, self._n_nodes - 1))

    def _repeat(self, event: Any) -> None:
        if event.anchor not in self._anchors:
            raise self._error(event, f"there is no anchor {event.anchor!r} to repeat")
        value, n_nodes = self._anchors[event.anchor]
        self._count(n_nodes, event)
        self._put(value, event, None, self._n_nodes)

    def _put(self, value: Any, event: Any, anchor: str | None, before: int) -> None:
        """Put a value where it belongs; `before` is the number of nodes before its own."""
        if anchor is not None:
            self._anchors[anchor] = value, self._n_nodes - before
        if not self._open:
            self._documents.append(value)
            return
        into = self._open[-1]
        if isinstance(into.values, list):
            into.values.append(value)
        elif into.has_key:
            self._put_entry(into, into.values, value, event)
            into.has_key = False
        elif isinstance(value, list | dict):
            raise self._error(event, "a list or mapping cannot be a key")
        else:
            plain = isinstance(event, yaml.ScalarEvent) and event.implicit[0]
            into.key, into.has_key, into.merges = value, True, plain and value == "<<"

    def _put_entry(self, into: _Open, values: dict[Any, Any], value: Any, event: Any) -> None:
        if into.merges:
            for one in value if isinstance(value, list) else [value]:
                if not isinstance(one, dict):
                    raise self._error(event, "<< takes a mapping or a list of mappings")
                into.merged = {**one, **into.merged}
        elif into.key in values:
            raise self._error(event, f"{into.key!r} is given twice")
        else:
            values[into.key] = value

    def _scalar(self, event: Any) -> Any:
        plain, quoted = event.implicit
        tag, text = event.tag or "", event.value
        if tag in (_TEXT, "!") or (not tag and quoted and not plain):
            return text
        value = _plain(text)
        if not tag:
            return value
        if type(value) not in _SCALARS.get(tag, ()):
            raise self._error(event, f"{text!r} with the tag {tag!r} is none of plain data")
        return value

    def _count(self, n: int, event: Any) -> None:
        self._n_nodes += n
        if self._n_nodes > self._max_nodes:
            raise self._error(event, f"it has more than {self._max_nodes} values")

    def _error(self, event: Any, problem: str) -> InputError:
        mark = event.start_mark
        return InputError(
            f"{self._what} is not valid YAML for us: {problem}, line {mark.line + 1}, column "
            f"{mark.column + 1}"
        )


def _plain(text: str) -> Any:
    """Return the value of a plain scalar by YAML 1.1; times of day and dates stay text."""
    if text in _WORDS:
        return _WORDS[text]
    if len(text) > MAX_YAML_NUMBER:
        return text
    if _INT.fullmatch(text):
        return _integer(text.replace("_", ""))
    return float(text.replace("_", "")) if _FLOAT.fullmatch(text) else text


def _integer(text: str) -> int:
    sign, digits = (-1, text[1:]) if text[0] == "-" else (1, text.removeprefix("+"))
    base = 10 if digits == "0" or digits[0] != "0" else {"x": 16, "b": 2}.get(digits[1], 8)
    return sign * int(digits[2:] if base in (16, 2) else digits, base)
