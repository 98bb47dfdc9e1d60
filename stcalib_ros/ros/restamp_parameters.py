"""Parameters of the clock relay."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stcalib_ros.core.errors import InputError
from stcalib_ros.ros.parameter_specs import CAMERAS, Spec, node_help
from stcalib_ros.ros.parameters import declared, require_camera_names, require_known

_RELIABILITIES = {
    "input_reliability": ("auto", "best_effort", "reliable"),
    "output_reliability": ("best_effort", "reliable"),
}
_TYPE = re.compile(r"\w+/msg/\w+", re.ASCII)

RELAY_SPECS = (
    Spec(
        "result_topic",
        "/calibrator/result",
        "Where the calibrator publishes its result; empty: only the file counts.",
        fixed=True,
    ),
    Spec("result_file", "", "Result file that holds until the topic has something.", fixed=True),
    Spec("output_prefix", "/restamped", "Put before the name of every topic.", fixed=True),
    Spec(
        "input_reliability",
        "auto",
        "best_effort, reliable, or auto: reliable while all publishers of the topic are.",
        fixed=True,
    ),
    Spec("output_reliability", "reliable", "best_effort or reliable.", fixed=True),
    Spec(
        "queue_depth", 10, "Messages that may wait, of each topic, in and out.", 1, 1000, fixed=True
    ),
)


@dataclass(frozen=True, slots=True)
class RelayedTopic:
    """A topic of a camera.

    Attributes
    ----------
    camera : str
    topic : str
    type_name : str
        Empty: that of its publisher.
    latched : bool
    """

    camera: str
    topic: str
    type_name: str
    latched: bool


@dataclass(frozen=True, slots=True)
class RelaySettings:
    """What the parameters say; attributes as in `RELAY_SPECS`."""

    topics: tuple[RelayedTopic, ...]
    result_topic: str
    result_file: Path | None
    output_prefix: str
    input_reliability: str
    output_reliability: str
    queue_depth: int


def relayed_topic_specs(name: str) -> tuple[Spec, Spec]:
    """Parameters of one camera.

    Examples
    --------
    >>> [spec.default for spec in relayed_topic_specs("cam0")]
    [['/cam0/image_raw', '/cam0/camera_info'], ['']]
    """
    return (
        Spec(
            f"camera.{name}.topics",
            [f"/{name}/image_raw", f"/{name}/camera_info"],
            "Topics with stamps of its clock, TOPIC or TOPIC:PACKAGE/msg/TYPE.",
            fixed=True,
        ),
        Spec(
            f"camera.{name}.latched_topics",
            [""],
            "More topics of its clock, which are latched.",
            fixed=True,
        ),
    )


def relay_specs(cameras: Iterable[str]) -> tuple[Spec, ...]:
    """All parameters but `CAMERAS`."""
    own = [spec for name in cameras for spec in relayed_topic_specs(name)]
    return (*own, *RELAY_SPECS)


def declare_relay(node: Any) -> RelaySettings:
    """Declare all parameters on a node and return what they say.

    Raises
    ------
    InputError
        A value has the wrong type, is out of its range or cannot be used, or there is no such
        parameter.
    """
    names = require_camera_names(declared(node, CAMERAS), at_least=1)
    topics = [
        _relayed_topic(spec.name, name, entry, latched)
        for name in names
        for spec, latched in zip(relayed_topic_specs(name), (False, True), strict=True)
        for entry in filter(None, declared(node, spec))
    ]
    values = {spec.name: declared(node, spec) for spec in RELAY_SPECS}
    require_known(node)
    return relay_settings(topics, **values)


def relay_settings(topics: Iterable[RelayedTopic], **values: Any) -> RelaySettings:
    """Settings from topics and the values of `RELAY_SPECS`.

    Raises
    ------
    InputError
        A value cannot be used.
    """
    topics = tuple(topics)
    if not topics:
        raise InputError("no topics: set camera.<name>.topics")
    names = [t.topic for t in topics]
    if twice := next((n for n in names if names.count(n) > 1), None):
        raise InputError(f"{twice} is given twice; a topic can have the clock of one camera only")
    for name, known in _RELIABILITIES.items():
        if values[name] not in known:
            raise InputError(f"{name}: {values[name]!r} is none of {', '.join(known)}")
    if not values["output_prefix"].strip("/"):
        raise InputError("output_prefix is empty, so that topics would be relayed to themselves")
    if not values["result_topic"] and not values["result_file"]:
        raise InputError(
            "result_topic and result_file are both empty: one of them is needed for time offsets"
        )
    file = Path(values["result_file"]).expanduser() if values["result_file"] else None
    return RelaySettings(topics=topics, **(values | {"result_file": file}))


def _relayed_topic(parameter: str, camera: str, entry: str, latched: bool) -> RelayedTopic:
    topic, _, type_name = entry.partition(":")
    if not topic or (type_name and not _TYPE.fullmatch(type_name)):
        raise InputError(f"{parameter}: {entry!r} is neither TOPIC nor TOPIC:PACKAGE/msg/TYPE")
    return RelayedTopic(camera, topic, type_name, latched)


def relay_help() -> str:
    """Return what the relay prints if it is asked for help."""
    what = "Republishes topics with the stamps of the reference camera's clock."
    return node_help("restamp", what, (CAMERAS, *relay_specs(["CAMERA"])))
