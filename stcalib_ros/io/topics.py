"""Which topic belongs to which camera."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

from stcalib_ros.core.errors import InputError, did_you_mean
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.io.lens_files import fields_by_camera
from stcalib_ros.io.lens_settings import (
    LENS_KEYS,
    LensFile,
    LensSettings,
    lens_settings,
    require_lens_groups,
)
from stcalib_ros.io.message_types import CAMERA_INFO, PERSON_POSES, TYPES, Content, types_of
from stcalib_ros.io.messages import CameraInfoFields
from stcalib_ros.io.topic_names import (
    camera_name,
    info_topic_of,
    pose_topic_ranks,
    topics_of_people,
)

_NO_LENS = LensSettings()
_POSES = ("person poses", "pose_topic")


@dataclass(frozen=True, slots=True)
class CameraTopics:
    """Topics, frame, line time (seconds per row) and lens of one camera; None: by convention."""

    pose_topic: str | None = None
    info_topic: str | None = None
    frame: str | None = None
    line_time_s: float | None = None
    lens: LensSettings = _NO_LENS


@dataclass(frozen=True, slots=True)
class CameraSelection:
    """Which cameras are wanted, in which order, and where they differ from the convention.

    Attributes
    ----------
    cameras : tuple of str or None
        None: every camera there is, ordered by name.
    camera : mapping of str to CameraTopics
    lens_file : LensFile or None
        Lenses of the cameras of which `camera` says nothing of the kind.
    """

    cameras: tuple[str, ...] | None = None
    camera: Mapping[str, CameraTopics] = field(default_factory=dict)
    lens_file: LensFile | None = None

    def with_line_delays(self, line_times_s: Mapping[str, float]) -> CameraSelection:
        """The same with line times by name of camera; they take precedence."""
        changed = {
            name: replace(self.camera.get(name, CameraTopics()), line_time_s=line_s)
            for name, line_s in line_times_s.items()
        }
        return replace(self, camera={**self.camera, **changed})

    def with_lens(
        self,
        name: str,
        *,
        knowledge: LensKnowledge | None = None,
        info: CameraInfoFields | None = None,
    ) -> CameraSelection:
        """The same with what is said of the lens of a camera, which takes precedence."""
        own = self.camera.get(name, CameraTopics())
        lens = replace(
            own.lens, knowledge=knowledge or own.lens.knowledge, info=info or own.lens.info
        )
        return replace(self, camera={**self.camera, name: replace(own, lens=lens)})


@dataclass(frozen=True, slots=True)
class SelectedCamera:
    """A camera and the topics that serve it.

    Attributes
    ----------
    name : str
    pose_topic, info_topic : str
    frame : str or None
        Optical frame; None: the frame_id of the poses.
    line_time_s : float
        Line delay of its shutter, seconds per row.
    lens : LensSettings
        What is said of its lens beside CameraInfo.
    pose_type, info_type : str
        Types of the topics, of `stcalib_ros.io.message_types.TYPES`.
    people_topics : tuple of str
        Topics of single persons, `pose_topic` among them; empty: that has all persons.
    """

    name: str
    pose_topic: str
    info_topic: str
    frame: str | None
    line_time_s: float = 0.0
    lens: LensSettings = _NO_LENS
    pose_type: str = PERSON_POSES.name
    info_type: str = CAMERA_INFO.name
    people_topics: tuple[str, ...] = ()

    @property
    def pose_topics(self) -> tuple[str, ...]:
        """All topics with poses."""
        return self.people_topics or (self.pose_topic,)


def selection_from_mapping(cameras: object, camera: object) -> CameraSelection:
    """Read the selection from the ``cameras`` and ``camera`` entries of a configuration file.

    Parameters
    ----------
    cameras : list of str or None
    camera : mapping of name to ``{pose_topic:, info_topic:, frame:, line_time_s:}`` or None
        And `stcalib_ros.io.lens_settings.LENS_KEYS`.

    Raises
    ------
    InputError
        They have another form, or a camera is named twice.
    """
    names: tuple[str, ...] | None = None
    if cameras is not None:
        if not isinstance(cameras, list) or not all(isinstance(c, str) and c for c in cameras):
            raise InputError(f"option cameras: expected a list of names, got {cameras!r}")
        if twice := sorted({c for c in cameras if cameras.count(c) > 1}):
            raise InputError(f"option cameras: two cameras have the same name: {', '.join(twice)}")
        names = tuple(cameras)
    if camera is None:
        return CameraSelection(names)
    if not isinstance(camera, Mapping):
        raise InputError(f"option camera: expected a mapping by camera name, got {camera!r}")
    own = {str(k): _topics(str(k), v) for k, v in camera.items()}
    require_lens_groups({name: topics.lens for name, topics in own.items()})
    return CameraSelection(names, own)


def _topics(name: str, given: Any) -> CameraTopics:
    topics = tuple(field.name for field in fields(CameraTopics) if field.name != "lens")
    known = (*topics, *LENS_KEYS)
    if not isinstance(given, Mapping):
        raise InputError(f"option camera.{name}: expected {', '.join(known)}, got {given!r}")
    for key, value in given.items():
        if key not in known:
            near = did_you_mean(str(key), known) or f": there are {', '.join(known)}"
            raise InputError(f"unknown option camera.{name}.{key}{near}")
        if key == "line_time_s" or key in LENS_KEYS:
            continue
        if not isinstance(value, str) or not value:
            raise InputError(f"option camera.{name}.{key}: expected text, got {value!r}")
    line_time = given.get("line_time_s")
    return CameraTopics(
        **{key: given[key] for key in topics if key in given and key != "line_time_s"},
        line_time_s=None if line_time is None else _seconds(line_time, f"camera.{name}"),
        lens=lens_settings(given, f"camera.{name}"),
    )


def _seconds(value: Any, path: str) -> float:
    """Line time; ``25e-6``, which YAML 1.1 takes for text, is a number, too."""
    if isinstance(value, int | float | str) and not isinstance(value, bool):
        try:
            return float(value)
        except ValueError:
            pass
    raise InputError(f"option {path}.line_time_s: expected seconds per image row, got {value!r}")


def select_cameras(
    types_by_topic: Mapping[str, str],
    selection: CameraSelection,
    *,
    find_info: Callable[[str], str | None] = lambda _pose_topic: None,
) -> tuple[SelectedCamera, ...]:
    """Cameras of the topics that there are.

    A topic whose type gives poses is a camera; its name is the topic's namespace
    (``/site/cam0/person_poses``: ``site/cam0``), its intrinsics the ``camera_info`` beside it, or
    the CameraInfo in the nearest namespace around it.

    Parameters
    ----------
    types_by_topic : mapping of str to str
        Type name of every topic.
    selection : CameraSelection
    find_info : callable, optional
        Given a topic with poses, returns that of their CameraInfo, where no name says it.

    Raises
    ------
    InputError
        There is no such topic, no CameraInfo, or two cameras have one name; the message lists
        what there is.
    """
    pose_topics = _pose_topics(types_by_topic, selection)
    _require_poses_of_settings(types_by_topic, selection, pose_topics)
    wanted = selection.cameras
    if wanted is None:
        wanted = tuple(sorted(pose_topics, key=_natural))
    if missing := [name for name in wanted if name not in pose_topics]:
        raise InputError(
            f"no person poses of camera {', '.join(missing)}; "
            f"the bag has {_listing(types_by_topic, Content.POSES)}"
        )
    pose_topics = {name: pose_topics[name] for name in wanted}
    lenses = _lenses(wanted, selection)
    info_topics = _info_topics(types_by_topic, selection, pose_topics, lenses, find_info)
    cameras = []
    for name, pose_topic in pose_topics.items():
        own, info_topic = selection.camera.get(name, CameraTopics()), info_topics[name]
        if own.info_topic or not _is_known(lenses[name]) or info_topic in types_by_topic:
            _require_type(types_by_topic, info_topic, Content.INTRINSICS, name)
        cameras.append(
            SelectedCamera(
                name=name,
                pose_topic=pose_topic,
                info_topic=info_topic,
                frame=own.frame,
                line_time_s=own.line_time_s or 0.0,
                lens=lenses[name],
                pose_type=types_by_topic[pose_topic],
                info_type=types_by_topic.get(info_topic, CAMERA_INFO.name),
                people_topics=topics_of_people(pose_topic, types_by_topic),
            )
        )
    return tuple(cameras)


def _lenses(wanted: Sequence[str], selection: CameraSelection) -> dict[str, LensSettings]:
    """Settings by camera; of those that have no lens of their own, by the file for all."""
    said = {name: selection.camera.get(name, CameraTopics()).lens for name in wanted}
    if (file := selection.lens_file) is None:
        return said
    found = fields_by_camera(file.lenses, [n for n, lens in said.items() if lens.info is None])
    if missing := [n for n in wanted if n not in found and said[n] == _NO_LENS]:
        raise InputError(
            f"{file.path} has no lens of camera {', '.join(missing)}: it has "
            f"{', '.join(file.lenses)}; give each camera its lens (--intrinsics "
            f"{missing[0]}=FILE:NAME, or {missing[0]}=given for its CameraInfo)"
        )
    return said | {
        name: replace(said[name], info=info, knowledge=said[name].knowledge or file.knowledge)
        for name, info in found.items()
    }


def _is_known(lens: LensSettings) -> bool:
    """Whether the settings of a camera say what CameraInfo would."""
    return lens.image_size is not None or lens.info is not None


def _info_topics(
    types_by_topic: Mapping[str, str],
    selection: CameraSelection,
    pose_topics: Mapping[str, str],
    lenses: Mapping[str, LensSettings],
    find_info: Callable[[str], str | None],
) -> dict[str, str]:
    """CameraInfo topics by camera: as the settings say, by their names, or as they are found.

    One that is found does not serve another camera.
    """
    own = {name: selection.camera.get(name, CameraTopics()).info_topic for name in pose_topics}
    named = {
        name: own[name] or info_topic_of(pose_topic, types_by_topic)
        for name, pose_topic in pose_topics.items()
    }
    found = {
        name: find_info(pose_topics[name])
        for name, info_topic in named.items()
        if not (info_topic in types_by_topic or own[name] or _is_known(lenses[name]))
    }
    serves = Counter([*named.values(), *found.values()])
    return named | {name: topic for name, topic in found.items() if topic and serves[topic] == 1}


def _require_poses_of_settings(
    types_by_topic: Mapping[str, str],
    selection: CameraSelection,
    pose_topics: Mapping[str, str],
) -> None:
    """Demand that what is said of a camera is said of one that there is."""
    for name, own in selection.camera.items():
        said = [("line_time_s", own.line_time_s is not None), ("intrinsics", own.lens != _NO_LENS)]
        if name not in pose_topics and (what := [key for key, is_said in said if is_said]):
            raise InputError(
                f"{what[0]} of camera {name}: there are no person poses of this camera; "
                f"the bag has {_listing(types_by_topic, Content.POSES)}"
            )


def _pose_topics(types_by_topic: Mapping[str, str], selection: CameraSelection) -> dict[str, str]:
    """Pose topics by camera name."""
    own = {n: t.pose_topic for n, t in selection.camera.items() if t.pose_topic is not None}
    for name, topic in own.items():
        _require_type(types_by_topic, topic, Content.POSES, name)
    ranks = pose_topic_ranks(types_by_topic)
    by_convention = [topic for topic in ranks if topic not in own.values()]
    if not own and not by_convention:
        kinds = " or ".join(map(_with_name, types_of(Content.POSES)))
        raise InputError(
            f"no topic of type {kinds}; the bag has "
            f"{_listing(types_by_topic)}; "
            "record the pose estimator's output, or make a bag with `stcalib convert`"
        )
    by_name = dict(own)
    named = {
        camera_name(topic, kind): kind
        for topic in own.values()
        if TYPES[kind := types_by_topic[topic]].topics
    }
    for topic in sorted(by_convention, key=lambda t: (ranks[t], t)):
        name = camera_name(topic, types_by_topic[topic])
        if name in own or named.get(name) == types_by_topic[topic]:
            continue
        other = by_name.setdefault(name, topic)
        alike = other != topic and ranks[other] == ranks[topic]
        if alike and not TYPES[types_by_topic[topic]].topic_per_person:
            raise InputError(
                f"two cameras have the same name, {name!r}: {other} and {topic}; "
                f"name them with camera.<name>.pose_topic in the configuration"
            )
    return by_name


def _require_type(
    types_by_topic: Mapping[str, str], topic: str, content: Content, camera: str
) -> None:
    wanted, actual = types_of(content), types_by_topic.get(topic)
    if actual in wanted:
        return
    what, key = ("CameraInfo", "info_topic") if content is Content.INTRINSICS else _POSES
    problem = "there is no such topic" if actual is None else f"its type is {actual}"
    raise InputError(
        f"camera {camera}: no {what} on {topic}: {problem}; the bag has "
        f"{_listing(types_by_topic, content)}; name its topic with camera.{camera}.{key} in "
        "the configuration"
    )


def _with_name(kind: str) -> str:
    """Type, and how its topics are called, where others of that type are something else."""
    known = TYPES[kind]
    return f"{kind} (.../{known.topics[0]})" if known.only_these else kind


def _listing(types_by_topic: Mapping[str, str], content: Content | None = None) -> str:
    """Topics with their types; of those with some content, by type."""
    if content is None:
        return ", ".join(f"{t} ({k})" for t, k in sorted(types_by_topic.items())) or "no topics"
    found = {
        kind: sorted(topic for topic, other in types_by_topic.items() if other == kind)
        for kind in types_of(content)
    }
    listed = [f"{kind} on {', '.join(topics)}" for kind, topics in found.items() if topics]
    return "; ".join(listed) or f"no topic of type {' or '.join(found)}"


def _natural(name: str) -> list[tuple[int, str]]:
    """Sort key by which cam2 comes before cam10."""
    return [
        (int(part), "") if part.isdecimal() else (-1, part)
        for part in re.split(r"(\d+)", name)
        if part
    ]
