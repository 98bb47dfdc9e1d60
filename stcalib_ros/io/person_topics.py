"""Images of a camera of which every person has a topic of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from stcalib_ros.io.message_types import TYPES
from stcalib_ros.io.message_types.pose_content import track_id_of
from stcalib_ros.io.messages import PoseImage


def with_person_of_topic(message: Any, topic: str, type_name: str) -> Any:
    """Return a message whose persons have the id that the topic names, if it names one.

    Examples
    --------
    The id of ``/cam0/humans/bodies/12/skeleton2d`` is 12.
    """
    if TYPES[type_name].topic_per_person:
        for person in message.persons:
            person.track_id = track_id_of(topic.split("/")[-2])
    return message


def merged_images(images: Sequence[PoseImage]) -> list[PoseImage]:
    """Return images with all persons of one stamp.

    Parameters
    ----------
    images : sequence of PoseImage
        Of one type of message, each with some of the persons and without 3D poses; those without
        any are of the frame of the others, whatever they say.
    """
    frames = [image.frame_id for image in images if len(image.track_ids)]
    by_stamp: dict[int, list[PoseImage]] = {}
    for image in images:
        is_empty = bool(frames) and not len(image.track_ids)
        part = replace(image, frame_id=frames[0]) if is_empty else image
        by_stamp.setdefault(image.stamp_ns, []).append(part)
    return [_merged(parts) for parts in by_stamp.values()]


def _merged(parts: Sequence[PoseImage]) -> PoseImage:
    return replace(
        parts[0],
        track_ids=np.concatenate([part.track_ids for part in parts]),
        scores=np.concatenate([part.scores for part in parts]),
        keypoints=np.concatenate([part.keypoints for part in parts]),
        joint_scores=np.concatenate([part.joint_scores for part in parts]),
        n_infinite=sum(part.n_infinite for part in parts),
    )
