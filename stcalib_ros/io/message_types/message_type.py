"""What there is to know of a message type to read it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
        The fields of ``stcalib_ros/PersonPose3DArray``; those of others have more, see
        `stcalib_ros.io.message_types.pose_content`.
    INTRINSICS
        Those of ``sensor_msgs/CameraInfo``.
    NOBODY
        As POSES, of the images without persons only.
    """

    POSES = "person poses"
    INTRINSICS = "intrinsics"
    NOBODY = "images without persons"


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
        Takes the fields of a message, in the order of the definition, from a `CdrReader`, and
        returns those of its content; None: the message holds none.
    topics : tuple of str
        Last parts of the names of topics, of which the first that there is serves a camera.
    only_these : bool
        Topics of other names are something else.
    topic_per_person : bool
        A topic has the messages of one person, whose id is the last part of its namespace.
    nobody_type : str
        Where a topic is a person's: type of the topic, above theirs, by which there is nobody.
    node : tuple of str
        Last parts of namespaces that are the node's and not the camera's.
    info_topics : tuple of str
        Last parts of the names of CameraInfo topics, where a camera has several; the first that
        there is serves.
    bytes_factor : int
        A message is at most so many times longer than one of ours with as many joints.
    install : str
        How its package is installed, where it is not part of ROS 2.
    """

    name: str
    content: Content
    definition: Callable[[], str]
    dependencies: tuple[Definition, ...]
    decode: Callable[[CdrReader], SimpleNamespace | None]
    topics: tuple[str, ...] = ()
    only_these: bool = False
    topic_per_person: bool = False
    nobody_type: str = ""
    node: tuple[str, ...] = ()
    info_topics: tuple[str, ...] = ()
    bytes_factor: int = 1
    install: str = ""

    def schema_text(self) -> str:
        """Return the definition as bags carry it: with those of the fields' types after it."""
        return schema_text(self.definition(), self.dependencies)


def schema_text(definition: str, dependencies: Sequence[Definition]) -> str:
    """Return a definition as bags carry it: with those of the fields' types after it."""
    blocks = (f"{_SEPARATOR}\nMSG: {d.name}\n{d.text()}" for d in dependencies)
    return definition + "".join(blocks)


TIME = Definition("builtin_interfaces/Time", lambda: "int32 sec\nuint32 nanosec\n")
HEADER = Definition("std_msgs/Header", lambda: "builtin_interfaces/Time stamp\nstring frame_id\n")
POINT = Definition("geometry_msgs/Point", lambda: "float64 x\nfloat64 y\nfloat64 z\n")
VECTOR3 = Definition("geometry_msgs/Vector3", lambda: "float64 x\nfloat64 y\nfloat64 z\n")
QUATERNION = Definition(
    "geometry_msgs/Quaternion", lambda: "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n"
)
POSE = Definition("geometry_msgs/Pose", lambda: "Point position\nQuaternion orientation\n")


def decode_header(cdr: CdrReader) -> SimpleNamespace:
    """Take a ``std_msgs/Header``."""
    stamp = SimpleNamespace(sec=cdr.int32(), nanosec=cdr.uint32())
    return SimpleNamespace(stamp=stamp, frame_id=cdr.string())
