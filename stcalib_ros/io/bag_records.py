"""What a bag consists of, whatever its storage: topics and raw messages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


@dataclass(frozen=True, slots=True)
class TopicSchema:
    """A topic of a bag and the definition of its messages.

    Attributes
    ----------
    topic, type_name : str
    encoding : str
        Of the messages: ``cdr``.
    schema_encoding : str
        Of the definition: ``ros2msg``, ``ros2idl``; empty if there is none.
    schema : bytes
        Definition; empty if the bag has none.
    """

    topic: str
    type_name: str
    encoding: str
    schema_encoding: str
    schema: bytes


class RawMessage(NamedTuple):
    """A message as it is in the bag, and how much of the bag has been read with it, 0..1."""

    topic: str
    type_name: str
    log_time: int
    data: bytes
    fraction: float
