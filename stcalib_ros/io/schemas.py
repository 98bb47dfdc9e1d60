"""Message definitions as bags carry them, and the comparison with ours.

A changed definition can decode without an error into wrong numbers, so the text in the bag is
compared before anything is decoded.
"""

from __future__ import annotations

import difflib
import re

from stcalib_ros.core.errors import InputError
from stcalib_ros.msgdefs import definition

POSES = "stcalib_ros/msg/PersonPose3DArray"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"

_SEPARATOR = "=" * 80

_FOREIGN = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "sensor_msgs/RegionOfInterest": (
        "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n"
    ),
    "sensor_msgs/CameraInfo": (
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\n"
        "float64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] p\n"
        "uint32 binning_x\nuint32 binning_y\nRegionOfInterest roi\n"
    ),
}
"""Definitions of other packages, as ROS 2 Jazzy has them (fields only)."""


def schema_text(schema_name: str) -> str:
    """Text to write into a bag for a message type, definitions of its fields' types included.

    Parameters
    ----------
    schema_name : str
        `POSES` or `CAMERA_INFO`.
    """
    if schema_name == CAMERA_INFO:
        top = _FOREIGN["sensor_msgs/CameraInfo"]
        used = ["std_msgs/Header", "builtin_interfaces/Time", "sensor_msgs/RegionOfInterest"]
        blocks = [(name, _FOREIGN[name]) for name in used]
    else:
        top = definition(schema_name.rsplit("/", 1)[-1])
        used = ["std_msgs/Header", "builtin_interfaces/Time"]
        blocks = [(name, _FOREIGN[name]) for name in used]
        blocks.append(("stcalib_ros/PersonPose3D", definition("PersonPose3D")))
    return top + "".join(f"{_SEPARATOR}\nMSG: {name}\n{text}" for name, text in blocks)


def require_same_schema(topic: str, schema_name: str, text: str) -> None:
    """Compare a bag's definition of `schema_name` with ours.

    Parameters
    ----------
    topic : str
        For the message.
    schema_name : str
    text : str
        Of the bag, with the definitions of the fields' types after lines of ``=``.

    Raises
    ------
    InputError
        They differ in more than comments and white space; the message shows where.
    """
    if not text.strip():
        raise InputError(
            f"{topic}: the bag has no definition of {schema_name} to compare with ours; "
            "record it where stcalib_ros is built and sourced"
        )
    ours, theirs = _blocks(schema_name, schema_text(schema_name)), _blocks(schema_name, text)
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
    """Fields of the type `owner`, their types with package."""
    lines = (re.sub(r"\s+", " ", line.split("#", 1)[0]).strip() for line in text.splitlines())
    package = owner.partition("/")[0]
    return [
        re.sub(r"^(?=[A-Z]\w*[ \[])", f"{package}/", _short(re.sub(r" ?= ?", "=", line)))
        for line in lines
        if line
    ]
