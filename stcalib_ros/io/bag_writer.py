"""Write a bag that the ROS 2 tools read: profile ``ros2``, CDR messages, ``ros2msg`` schemas."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from mcap.writer import CompressionType, Writer

from stcalib_ros import __version__
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.core.model.recording import CameraRecording, Intrinsics, Recording, Track
from stcalib_ros.io.bag_origin import ORIGIN
from stcalib_ros.io.cdr import CdrWriter
from stcalib_ros.io.files import atomic_path, require_writable
from stcalib_ros.io.message_types import CAMERA_INFO, PERSON_POSES, TYPES
from stcalib_ros.io.messages import NS, fields_of_lens

_INFO_EVERY_NS = NS

_QOS = yaml.safe_dump(
    [
        {
            "history": 1,
            "depth": 10,
            "reliability": 1,
            "durability": 2,
            "deadline": {"sec": 0, "nsec": 0},
            "lifespan": {"sec": 0, "nsec": 0},
            "liveliness": 1,
            "liveliness_lease_duration": {"sec": 0, "nsec": 0},
            "avoid_ros_namespace_conventions": False,
        }
    ],
    sort_keys=False,
)
"""Keep last 10, reliable, volatile: offered so, best-effort subscribers are served as well."""


class _Message(NamedTuple):
    stamp_ns: int
    topic: str
    data: bytes


def write_bag(
    recording: Recording, path: Path | str, *, origin: Mapping[str, str] | None = None
) -> None:
    """Write person poses and CameraInfo of every camera as a bag.

    Parameters
    ----------
    recording : Recording
        Written as float32, as the messages have it.
    path : Path or str
        Ends in ``.mcap``: one file, an existing one is replaced. Else a rosbag2 folder with
        ``metadata.yaml``, which must not exist yet.
    origin : mapping of str to str, optional
        What the bag was made from, for `stcalib_ros.io.bag_origin.read_origin`.

    Raises
    ------
    InputError
        The bag cannot be written there. Nothing is left behind then, nor after Ctrl-C.

    Examples
    --------
    >>> import stcalib_ros as st
    >>> scene = st.simulate(st.SceneOptions(n_cameras=2, n_frames=30))
    >>> st.write_bag(scene.recording, "walk.mcap")
    """
    path = Path(path)
    if not _is_folder_name(path):
        with atomic_path(path) as temporary:
            _write_file(_topics(recording), _messages(recording), temporary, origin)
        return
    require_bag_writable(path)
    topics, messages, name = _topics(recording), _messages(recording), f"{path.name}_0.mcap"
    with atomic_path(path) as temporary:
        temporary.mkdir()
        _write_file(topics, messages, temporary / name, origin)
        metadata = _metadata(topics, messages, name)
        (temporary / "metadata.yaml").write_text(metadata, encoding="utf-8")


def require_bag_writable(path: Path) -> None:
    """Make sure, before the long work, that a bag can be written to `path`.

    Raises
    ------
    InputError
        It cannot; a folder must not exist yet, and must not be named like a file of another kind.
    """
    if _is_folder_name(path) and any(character.isalpha() for character in path.suffix):
        raise InputError(
            f"cannot write a bag to {path}: the name of a bag ends in .mcap, or that of a bag "
            f"folder has no ending; name it {path.with_suffix('.mcap')}"
        )
    if _is_folder_name(path) and path.exists():
        raise InputError(
            f"cannot write the bag folder {path}: it exists; remove it or name another"
        )
    require_writable(path)


def _is_folder_name(path: Path) -> bool:
    return path.suffix != ".mcap"


def _write_file(
    topics: Mapping[str, str],
    messages: Sequence[_Message],
    path: Path,
    origin: Mapping[str, str] | None,
) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library=f"stcalib_ros {__version__}")
        schemas = {
            kind: writer.register_schema(kind, "ros2msg", TYPES[kind].schema_text().encode())
            for kind in (PERSON_POSES.name, CAMERA_INFO.name)
        }
        metadata = {"offered_qos_profiles": _QOS}
        channels = {
            topic: writer.register_channel(topic, "cdr", schemas[kind], metadata)
            for topic, kind in topics.items()
        }
        if origin is not None:
            writer.add_metadata(ORIGIN, dict(origin))
        for sequence, message in enumerate(messages):
            writer.add_message(
                channel_id=channels[message.topic],
                log_time=message.stamp_ns,
                publish_time=message.stamp_ns,
                sequence=sequence,
                data=message.data,
            )
        writer.finish()  # type: ignore[no-untyped-call]


def _topics(recording: Recording) -> dict[str, str]:
    topics = {}
    for camera in recording.cameras:
        topics[f"/{camera.name}/camera_info"] = CAMERA_INFO.name
        topics[f"/{camera.name}/person_poses"] = PERSON_POSES.name
    return topics


def _messages(recording: Recording) -> list[_Message]:
    """All messages by stamp; a CameraInfo at the start of its camera and every second."""
    messages = [
        message
        for camera in recording.cameras
        for message in _camera_messages(camera, recording.epoch_ns)
    ]
    return sorted(messages, key=lambda message: message.stamp_ns)


def _camera_messages(camera: CameraRecording, epoch_ns: int) -> Iterator[_Message]:
    rows_by_frame: dict[int, list[tuple[Track, int]]] = {}
    for track in camera.tracks:
        for row, frame in enumerate(track.frames):
            rows_by_frame.setdefault(int(frame), []).append((track, row))
    next_info = None
    for frame, stamp in enumerate(camera.stamps):
        stamp_ns = epoch_ns + round(float(stamp) * NS)
        if next_info is None or stamp_ns >= next_info:
            yield _Message(stamp_ns, f"/{camera.name}/camera_info", _info_data(camera, stamp_ns))
            next_info = stamp_ns + _INFO_EVERY_NS
        data = _poses_data(camera, stamp_ns, rows_by_frame.get(frame, []))
        yield _Message(stamp_ns, f"/{camera.name}/person_poses", data)


def _header(cdr: CdrWriter, stamp_ns: int, frame_id: str) -> None:
    cdr.int32(stamp_ns // NS)
    cdr.uint32(stamp_ns % NS)
    cdr.string(frame_id)


def _poses_data(camera: CameraRecording, stamp_ns: int, persons: list[tuple[Track, int]]) -> bytes:
    layout = camera.layout
    cdr = CdrWriter()
    _header(cdr, stamp_ns, camera.frame_id)
    cdr.string(layout.name)
    cdr.strings(() if layout == LAYOUTS.get(layout.name) else layout.joint_names)
    cdr.boolean(_is_rectified(camera.intrinsics))
    cdr.boolean(camera.metric)
    cdr.uint32(len(persons))
    for track, row in persons:
        cdr.uint32(track.track_id)
        cdr.float32(float(track.scores[row].mean()))
        cdr.float32s(track.joints[row] if np.isfinite(track.joints[row]).any() else ())
        cdr.float32s(track.keypoints[row])
        cdr.float32s(track.scores[row])
    return cdr.data()


def _info_data(camera: CameraRecording, stamp_ns: int) -> bytes:
    info = fields_of_lens(camera.intrinsics)
    cdr = CdrWriter()
    _header(cdr, stamp_ns, camera.frame_id)
    cdr.uint32(info.height)
    cdr.uint32(info.width)
    cdr.string(info.distortion_model)
    cdr.float64s(camera.intrinsics.D)
    for matrix in (info.k, info.r, info.p):
        cdr.float64s(matrix, fixed=True)
    for binning_or_roi in (0, 0, 0, 0, 0, 0):
        cdr.uint32(binning_or_roi)
    cdr.boolean(False)
    return cdr.data()


def _is_rectified(lens: Intrinsics) -> bool:
    return not np.array_equal(lens.R_rect_cam, np.eye(3))


def _metadata(topics: Mapping[str, str], messages: Sequence[_Message], file_name: str) -> str:
    """Content of ``metadata.yaml`` in the form of Humble, which later releases read as well."""
    start = messages[0].stamp_ns if messages else 0
    duration = {"nanoseconds": messages[-1].stamp_ns - start if messages else 0}
    starting_time = {"nanoseconds_since_epoch": start}
    counts = dict.fromkeys(topics, 0)
    for message in messages:
        counts[message.topic] += 1
    information = {
        "version": 5,
        "storage_identifier": "mcap",
        "duration": duration,
        "starting_time": starting_time,
        "message_count": len(messages),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic,
                    "type": kind,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": _QOS,
                },
                "message_count": counts[topic],
            }
            for topic, kind in topics.items()
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [
            {
                "path": file_name,
                "starting_time": dict(starting_time),
                "duration": dict(duration),
                "message_count": len(messages),
            }
        ],
    }
    return yaml.safe_dump({"rosbag2_bagfile_information": information}, sort_keys=False)
