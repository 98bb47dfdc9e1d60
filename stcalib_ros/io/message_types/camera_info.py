"""``sensor_msgs/CameraInfo``: the intrinsics of a camera."""

from __future__ import annotations

from types import SimpleNamespace

from stcalib_ros.io.cdr import CdrReader
from stcalib_ros.io.message_types.message_type import (
    HEADER,
    TIME,
    Content,
    Definition,
    MessageType,
    decode_header,
)

_DEFINITION = """\
std_msgs/Header header
uint32 height
uint32 width
string distortion_model
float64[] d
float64[9] k
float64[9] r
float64[12] p
uint32 binning_x
uint32 binning_y
RegionOfInterest roi
"""
_REGION = """\
uint32 x_offset
uint32 y_offset
uint32 height
uint32 width
bool do_rectify
"""


def _decode(cdr: CdrReader) -> SimpleNamespace:
    # Keyword arguments are evaluated in their order, which is that of the definition.
    return SimpleNamespace(
        header=decode_header(cdr),
        height=cdr.uint32(),
        width=cdr.uint32(),
        distortion_model=cdr.string(),
        d=cdr.float64s(),
        k=cdr.float64s(9),
        r=cdr.float64s(9),
        p=cdr.float64s(12),
        binning_x=cdr.uint32(),
        binning_y=cdr.uint32(),
        roi=_decode_region(cdr),
    )


def _decode_region(cdr: CdrReader) -> SimpleNamespace:
    return SimpleNamespace(
        x_offset=cdr.uint32(),
        y_offset=cdr.uint32(),
        height=cdr.uint32(),
        width=cdr.uint32(),
        do_rectify=cdr.boolean(),
    )


CAMERA_INFO = MessageType(
    name="sensor_msgs/msg/CameraInfo",
    content=Content.INTRINSICS,
    definition=lambda: _DEFINITION,
    dependencies=(HEADER, TIME, Definition("sensor_msgs/RegionOfInterest", lambda: _REGION)),
    decode=_decode,
)
"""As ROS 2 Jazzy has it (fields only)."""
