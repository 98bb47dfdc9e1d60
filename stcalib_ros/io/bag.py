"""Read a bag: an MCAP or SQLite file or a rosbag2 folder, with or without ROS."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.io.assemble import CameraImages, Warn, assemble_recording
from stcalib_ros.io.bag_files import bag_files
from stcalib_ros.io.bag_records import RawMessage, TopicSchema
from stcalib_ros.io.bag_source import one_line, raw_messages, topic_schemas
from stcalib_ros.io.info_by_frame import info_topic_by_frame
from stcalib_ros.io.lens_settings import info_with_size
from stcalib_ros.io.limits import MAX_UNSTAMPED
from stcalib_ros.io.message_types import Content, decode, decode_whole, types_of
from stcalib_ros.io.messages import (
    CameraInfoFields,
    PoseImage,
    camera_info_fields,
    format_stamp,
    pose_image,
    stamp_ns,
)
from stcalib_ros.io.person_topics import merged_images, with_person_of_topic
from stcalib_ros.io.schemas import require_same_schema
from stcalib_ros.io.topics import CameraSelection, SelectedCamera, select_cameras

Progress = Callable[[str, float], None]
Decoder = Callable[[str, bytes], Any]

STAGE = "reading the bag"
_PROGRESS_EVERY = 200  # messages


def read_bag(
    path: Path | str,
    *,
    selection: CameraSelection | None = None,
    progress: Progress | None = None,
    decoder: Decoder | None = None,
    warn: Warn | None = None,
) -> Recording:
    """Read the persons that every camera of a bag saw.

    Parameters
    ----------
    path : Path or str
        ``.mcap`` or ``.db3`` file, or rosbag2 folder; packed as a whole or message by message, too.
    selection : CameraSelection, optional
        Which cameras, in which order, and their topics. Default: every topic of a type that gives
        poses, see `stcalib_ros.io.message_types.TYPES`, with the CameraInfo in its namespace.
    progress : callable, optional
        Called with a stage and the fraction of it that is done.
    decoder : callable, optional
        Given a type name (``stcalib_ros/msg/PersonPose3DArray``) and the CDR bytes, returns the
        message. Default: decoding without ROS.
    warn : callable, optional
        Called with one line for each oddity that did not stop the reading. Default: the logger
        of the module.

    Returns
    -------
    Recording
        Images ordered by header stamp, whatever their order in the bag.

    Raises
    ------
    InputError
        The bag is missing, damaged or holds nothing of use; the message says what and what to do.

    Examples
    --------
    >>> import stcalib_ros as st
    >>> st.write_bag(st.simulate(st.SceneOptions(n_cameras=2, n_frames=30)).recording, "walk.mcap")
    >>> [(camera.name, len(camera.stamps)) for camera in st.read_bag("walk.mcap").cameras]
    [('cam0', 30), ('cam1', 30)]
    """
    warn = warn or logging.getLogger(__name__).warning
    bag = _opened_bag(path, selection, warn)
    contents = _Contents(bag.cameras, decoder or decode, bag.undefined)
    topics = frozenset(topic for c in bag.cameras for topic in (*c.pose_topics, c.info_topic))
    contents.collect(raw_messages(bag.files, topics), progress or _no_progress)
    if bag.undefined:
        warn(
            f"{path} lacks the message definitions of {len(bag.undefined)} topics: "
            f"{', '.join(sorted(bag.undefined))}; ours are used, and the messages fit them"
        )
    return assemble_recording(contents.cameras(path, warn), warn=warn)


def open_bag(
    path: Path | str, *, selection: CameraSelection | None = None, warn: Warn | None = None
) -> tuple[tuple[Path, ...], tuple[SelectedCamera, ...]]:
    """Files of a bag, and its cameras, whose messages have our definitions or none.

    Parameters and errors are those of `read_bag`.
    """
    bag = _opened_bag(path, selection, warn or logging.getLogger(__name__).warning)
    return bag.files, bag.cameras


class _Bag(NamedTuple):
    """Files, cameras, and those of the cameras' topics that the bag has no definition of."""

    files: tuple[Path, ...]
    cameras: tuple[SelectedCamera, ...]
    undefined: frozenset[str]


def _opened_bag(path: Path | str, selection: CameraSelection | None, warn: Warn) -> _Bag:
    files = bag_files(Path(path), warn=warn)
    schemas = topic_schemas(files)
    types = _types_by_topic(path, schemas)
    cameras = select_cameras(
        types,
        selection or CameraSelection(),
        find_info=lambda pose_topic: info_topic_by_frame(pose_topic, files, types),
    )
    return _Bag(files, cameras, _undefined(schemas, cameras))


class _Contents:
    """Messages of the chosen topics, converted."""

    def __init__(
        self, cameras: Sequence[SelectedCamera], decoder: Decoder, undefined: frozenset[str]
    ) -> None:
        self._cameras = cameras
        self._decoder = decoder
        self._undefined = undefined
        self._camera_topic = {topic: c.pose_topic for c in cameras for topic in c.pose_topics}
        self._images: dict[str, list[PoseImage]] = {c.pose_topic: [] for c in cameras}
        self._unstamped = dict.fromkeys(self._images, 0)
        self._infos: dict[str, tuple[CameraInfoFields, int]] = {}

    def collect(self, messages: Iterable[RawMessage], progress: Progress) -> None:
        """Take in messages."""
        progress(STAGE, 0.0)
        for count, raw in enumerate(messages, start=1):
            if count % _PROGRESS_EVERY == 0:
                progress(STAGE, raw.fraction)
            message = self._decoded(raw)
            if message is None:
                continue
            topic = self._camera_topic.get(raw.topic)
            if topic is None:
                self._take_info(raw, camera_info_fields(message))
            elif stamp_ns(message) == 0:
                self._unstamped[topic] += 1
            else:
                message = with_person_of_topic(message, raw.topic, raw.type_name)
                image = pose_image(message, topic=raw.topic, received_ns=raw.log_time)
                self._images[topic].append(image)
        progress(STAGE, 1.0)

    def cameras(self, path: Path | str, warn: Warn) -> list[CameraImages]:
        """Cameras that have images."""
        self._leave_out_unstamped(warn)
        if not any(self._images.values()):
            raise InputError(
                f"{path} holds no person poses: no message on {', '.join(self._images)}"
            )
        out = []
        for camera in self._cameras:
            images = self._images[camera.pose_topic]
            if camera.people_topics:
                images = merged_images(images)
            if not images:
                warn(f"camera {camera.name} is left out: no message on {camera.pose_topic}")
                continue
            published, _ = self._infos.get(camera.info_topic, (None, 0))
            info = info_with_size(published, camera.lens, f"camera {camera.name}")
            if info is None:
                raise InputError(
                    f"camera {camera.name}: no message on {camera.info_topic}; record it, or give "
                    f"camera.{camera.name}.image_size in the configuration"
                )
            out.append(
                CameraImages(
                    name=camera.name,
                    images=images,
                    info=info,
                    pose_topic=camera.pose_topic,
                    info_topic=camera.info_topic,
                    frame_id=camera.frame,
                    line_time_s=camera.line_time_s,
                    settings=camera.lens,
                )
            )
        return out

    def _leave_out_unstamped(self, warn: Warn) -> None:
        """Count images with a stamp of zero; a camera that has mostly such ones has no images."""
        for topic, n_without in self._unstamped.items():
            n = n_without + len(self._images[topic])
            if n_without > MAX_UNSTAMPED * n:
                self._images[topic] = []
                text = (
                    f"{topic}: header stamp is zero in {n_without} of {n} images; the publisher "
                    "must stamp its messages with the acquisition time of the image"
                )
                if not any(self._images.values()):
                    raise InputError(text)
                warn(text)
            elif n_without:
                warn(f"{topic}: {n_without} of {n} images are left out: their header stamp is zero")

    def _decoded(self, raw: RawMessage) -> Any:
        try:
            if raw.topic in self._undefined:
                decode_whole(raw.type_name, raw.data)
            return self._decoder(raw.type_name, raw.data)
        except Exception as error:  # whatever a decoder says about damaged bytes
            raise InputError(
                f"{raw.topic}: the message logged at {format_stamp(raw.log_time)} cannot be "
                f"decoded as {' '.join(raw.type_name.split())} ({one_line(error)})"
            ) from error

    def _take_info(self, raw: RawMessage, info: CameraInfoFields) -> None:
        known, since = self._infos.setdefault(raw.topic, (info, raw.log_time))
        if known == info:
            return
        field = next(f for f in info._fields if getattr(known, f) != getattr(info, f))
        before, after = (repr(getattr(one, field)) for one in (known, info))
        raise InputError(
            f"{raw.topic}: CameraInfo changes in the middle: {field} is {before} at "
            f"{format_stamp(since)} and {after} at {format_stamp(raw.log_time)}; use a part of the "
            "bag with one lens"
        )


def _types_by_topic(path: Path | str, schemas: Sequence[TopicSchema]) -> dict[str, str]:
    if not schemas:
        raise InputError(f"{path} is an empty bag: it has no topics")
    poses = types_of(Content.POSES)
    types: dict[str, str] = {}
    for s in schemas:
        other = types.setdefault(s.topic, s.type_name)
        if other != s.type_name and (other in poses or s.type_name in poses):
            raise InputError(f"{s.topic} has two types in the bag: {other} and {s.type_name}")
    return types


def _undefined(schemas: Iterable[TopicSchema], cameras: Iterable[SelectedCamera]) -> frozenset[str]:
    """Demand an encoding that we read, and definitions that are ours, of the cameras' topics.

    SQLite bags of Humble have no definitions, and some are not written as ros2msg. Their topics
    are returned: whether our definitions hold, the messages have to show.
    """
    wanted = {topic for c in cameras for topic in (*c.pose_topics, c.info_topic)}
    undefined = set()
    for s in schemas:
        if s.topic not in wanted:
            continue
        if s.encoding != "cdr":
            raise InputError(
                f"{s.topic}: messages encoded as {s.encoding!r} with a definition as "
                f"{s.schema_encoding!r}; expected 'cdr', as ROS 2 records them"
            )
        try:
            text = s.schema.decode()
        except UnicodeDecodeError as error:
            raise InputError(f"{s.topic}: the definition of {s.type_name} is not text") from error
        if s.schema_encoding == "ros2msg" and text.strip():
            require_same_schema(s.topic, s.type_name, text)
        else:
            undefined.add(s.topic)
    return frozenset(undefined)


def _no_progress(_stage: str, _fraction: float) -> None:
    """Tell nobody."""
