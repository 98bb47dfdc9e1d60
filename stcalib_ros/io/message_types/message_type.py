"""What there is to know of a message type to read it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from types import SimpleNamespace

from stcalib_ros.io.cdr import CdrReader

_SEPARATOR = "=" * 80


class Content(Enum):
    """What messages give once they are decoded, whatever their type.

    Attributes
    ----------
    POSES
        The fields of ``stcalib_ros/PersonPose3DArray``.
    INTRINSICS
        Those of ``sensor_msgs/CameraInfo``.
    """

    POSES = "person poses"
    INTRINSICS = "intrinsics"


@dataclass(frozen=True, slots=True)
class Definition:
    """Text of a ``.msg`` file; `name` is without ``/msg/``, as in bags."""

    name: str
    text: Callable[[], str]


@dataclass(frozen=True, slots=True)
class MessageType:
    """A message type.

    Attributes
    ----------
    name : str
        As in bags: ``package/msg/Name``.
    content : Content
        What its messages give.
    definition : callable
        Returns the text of its ``.msg`` file.
    dependencies : tuple of Definition
        Types of its fields, and of their fields.
    decode : callable
        Takes the fields of a message, in the order of the definition, from a `CdrReader`.
    """

    name: str
    content: Content
    definition: Callable[[], str]
    dependencies: tuple[Definition, ...]
    decode: Callable[[CdrReader], SimpleNamespace]

    def schema_text(self) -> str:
        """Return the definition as bags carry it: with those of the fields' types after it."""
        blocks = (f"{_SEPARATOR}\nMSG: {d.name}\n{d.text()}" for d in self.dependencies)
        return self.definition() + "".join(blocks)


TIME = Definition("builtin_interfaces/Time", lambda: "int32 sec\nuint32 nanosec\n")
HEADER = Definition("std_msgs/Header", lambda: "builtin_interfaces/Time stamp\nstring frame_id\n")


def decode_header(cdr: CdrReader) -> SimpleNamespace:
    """Take a ``std_msgs/Header``."""
    stamp = SimpleNamespace(sec=cdr.int32(), nanosec=cdr.uint32())
    return SimpleNamespace(stamp=stamp, frame_id=cdr.string())
