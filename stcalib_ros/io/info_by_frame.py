"""The CameraInfo of a camera by its frame, where the names of topics do not say."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

from stcalib_ros.io.bag_source import raw_messages
from stcalib_ros.io.cdr import CdrReader
from stcalib_ros.io.message_types import Content, types_of
from stcalib_ros.io.message_types.message_type import decode_header
from stcalib_ros.io.topic_names import preferred_info


def info_topic_by_frame(
    pose_topic: str, files: Sequence[Path], types_by_topic: Mapping[str, str]
) -> str | None:
    """CameraInfo topic whose messages have the frame of the poses; None if there is not just one.

    Parameters
    ----------
    pose_topic : str
    files : sequence of Path
        Of the bag.
    types_by_topic : mapping of str to str
        Type name of every topic.
    """
    lenses = types_of(Content.INTRINSICS)
    infos = [topic for topic, kind in types_by_topic.items() if kind in lenses]
    frames = _first_frames(files, frozenset([pose_topic, *infos]))
    wanted = frames.get(pose_topic, "")
    alike = [topic for topic in infos if wanted and frames.get(topic) == wanted]
    return preferred_info(alike, types_by_topic[pose_topic])


def _first_frames(files: Sequence[Path], topics: frozenset[str]) -> dict[str, str]:
    """Frames of the first message of each topic, where it begins with a header."""
    frames: dict[str, str] = {}
    for raw in raw_messages(files, topics):
        if raw.topic not in frames:
            try:
                frames[raw.topic] = decode_header(CdrReader(raw.data)).frame_id
            except (ValueError, struct.error):
                frames[raw.topic] = ""
            if len(frames) == len(topics):
                break
    return frames
