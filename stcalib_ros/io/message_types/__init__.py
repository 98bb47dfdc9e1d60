"""The message types that are read, from bags and from topics alike.

A new one is a module of this folder with its `MessageType`, and an entry in `TYPES`.
"""

from __future__ import annotations

from types import SimpleNamespace

from stcalib_ros.io.cdr import CdrReader
from stcalib_ros.io.limits import MAX_PADDING_BYTES
from stcalib_ros.io.message_types.body_markers import BODY_MARKERS
from stcalib_ros.io.message_types.camera_info import CAMERA_INFO
from stcalib_ros.io.message_types.hiros_skeletons import HIROS_SKELETONS
from stcalib_ros.io.message_types.hri_skeletons import HRI_IDS, HRI_SKELETONS
from stcalib_ros.io.message_types.message_type import Content, MessageType
from stcalib_ros.io.message_types.person_poses import PERSON_POSES
from stcalib_ros.io.message_types.pose_content import NO_TRACK
from stcalib_ros.io.message_types.yolo_detections import YOLO_DETECTIONS, YOLOV8_DETECTIONS
from stcalib_ros.io.message_types.zed_bodies import ZED_BODIES, ZED_INTERFACES_BODIES

__all__ = [
    "CAMERA_INFO",
    "NO_TRACK",
    "PERSON_POSES",
    "TYPES",
    "Content",
    "MessageType",
    "decode",
    "decode_whole",
    "types_of",
]

_KNOWN = (
    PERSON_POSES,
    YOLO_DETECTIONS,
    YOLOV8_DETECTIONS,
    ZED_BODIES,
    ZED_INTERFACES_BODIES,
    BODY_MARKERS,
    HRI_SKELETONS,
    HRI_IDS,
    HIROS_SKELETONS,
    CAMERA_INFO,
)

TYPES = {known.name: known for known in _KNOWN}
"""Message types by name; of those that give the poses of one camera, the first serves."""


def types_of(content: Content) -> tuple[str, ...]:
    """Return the names of the types that give a content."""
    return tuple(name for name, known in TYPES.items() if known.content is content)


def decode(type_name: str, data: bytes) -> SimpleNamespace | None:
    """Decode a message.

    Parameters
    ----------
    type_name : str
        One of `TYPES`; the definition of the writer must be ours.
    data : bytes
        Plain CDR.

    Returns
    -------
    SimpleNamespace or None
        With the fields that its content has, see `Content`; None: it holds nothing of that kind.

    Raises
    ------
    ValueError, struct.error
        The data are not plain CDR, or end before the message does.
    """
    return TYPES[type_name].decode(CdrReader(data))


def decode_whole(type_name: str, data: bytes) -> SimpleNamespace | None:
    """Decode a message that the definition has to account for to its last byte.

    Parameters and errors are those of `decode`. A message of another definition has bytes left, or
    too few, unless its fields have the same lengths.
    """
    cdr = CdrReader(data)
    message = TYPES[type_name].decode(cdr)
    if not 0 <= cdr.left <= MAX_PADDING_BYTES:
        raise ValueError(f"{cdr.left} bytes are left: it was written with another definition")
    return message
