"""What the names of topics say: which camera they belong to, and which of them serve it."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping, Sequence

from stcalib_ros.io.message_types import PERSON_POSES, TYPES, Content, types_of


def camera_name(pose_topic: str, pose_type: str = PERSON_POSES.name) -> str:
    """Name of the camera that publishes on a topic: the topic's namespace, without the node's own.

    Examples
    --------
    >>> camera_name("/cam0/person_poses")
    'cam0'
    >>> camera_name("/cam0/yolo/tracking", "yolo_msgs/msg/DetectionArray")
    'cam0'
    """
    *namespace, last = pose_topic.strip("/").split("/")
    node = TYPES[pose_type].node
    if TYPES[pose_type].topic_per_person:
        namespace = namespace[:-1]
    if node and len(namespace) > len(node) and tuple(namespace[-len(node) :]) == node:
        namespace = namespace[: -len(node)]
    return "/".join(namespace) or last


def name_for_topics(text: str) -> str:
    """Return a name of a camera as topics can have it: letters a to z, digits and underscores.

    Examples
    --------
    >>> name_for_topics("Küche 1"), name_for_topics("2")
    ('Kuche_1', 'cam2')
    """
    split = unicodedata.normalize("NFKD", text)
    bare = "".join(one for one in split if not unicodedata.combining(one))
    name = re.sub(r"\W", "_", bare, flags=re.ASCII).strip("_")
    return f"cam{name}" if name[:1].isdigit() else name


def topics_of_people(pose_topic: str, types_by_topic: Mapping[str, str]) -> tuple[str, ...]:
    """All topics of the people of a camera, where every one has their own; else none.

    With them comes the topic by which there is nobody.

    Parameters
    ----------
    pose_topic : str
        One of them.
    types_by_topic : mapping of str to str
        Type name of every topic.
    """
    kind = types_by_topic[pose_topic]
    if not TYPES[kind].topic_per_person:
        return ()
    name = camera_name(pose_topic, kind)
    return tuple(
        topic
        for topic, other in sorted(types_by_topic.items())
        if is_of_people(topic, other, kind) and camera_name(topic, other) == name
    )


def is_of_people(topic: str, type_name: str, pose_type: str) -> bool:
    """Whether a topic is one person's of those of a type, or that by which there is nobody."""
    if type_name == pose_type:
        return True
    last = topic.rpartition("/")[2]
    return type_name == TYPES[pose_type].nobody_type and last in TYPES[type_name].topics


def pose_topic_ranks(types_by_topic: Mapping[str, str]) -> dict[str, tuple[int, int]]:
    """Topics that give poses; of those of one camera, that of the lowest rank serves it.

    Parameters
    ----------
    types_by_topic : mapping of str to str
        Type name of every topic.
    """
    kinds = types_of(Content.POSES)
    ranks = {}
    for topic, kind in types_by_topic.items():
        if kind not in kinds:
            continue
        usual, last = TYPES[kind].topics, topic.rpartition("/")[2]
        if last in usual or not TYPES[kind].only_these:
            place = usual.index(last) if last in usual else len(usual)
            ranks[topic] = (kinds.index(kind), place)
    return ranks


def info_topic_of(pose_topic: str, types_by_topic: Mapping[str, str]) -> str:
    """CameraInfo topic of a camera: beside its poses, else in the nearest namespace around them.

    Not above the namespace of the camera, where those of other cameras are. Of several, it is the
    one that the type of the poses prefers; if none is found, the one beside the poses.

    Parameters
    ----------
    pose_topic : str
    types_by_topic : mapping of str to str
        Type name of every topic.
    """
    lenses = types_of(Content.INTRINSICS)
    infos = [topic for topic, kind in types_by_topic.items() if kind in lenses]
    pose_type = types_by_topic[pose_topic]
    own = f"/{camera_name(pose_topic, pose_type)}"
    namespace = pose_topic.rpartition("/")[0]
    beside = f"{namespace}/camera_info"
    if beside in infos:
        return beside
    while namespace.startswith(own):
        around = [topic for topic in infos if topic.startswith(f"{namespace}/")]
        if around:
            return preferred_info(around, pose_type) or beside
        namespace = namespace.rpartition("/")[0]
    return beside


def preferred_info(info_topics: Sequence[str], pose_type: str) -> str | None:
    """Of several CameraInfo topics that which a type of poses prefers; None if it has no choice."""
    preferred = (
        topic
        for last in TYPES[pose_type].info_topics
        for topic in info_topics
        if topic.endswith(f"/{last}")
    )
    return next(preferred, info_topics[0] if len(info_topics) == 1 else None)
